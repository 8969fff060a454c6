#include "palpate/mesh/solid_pieces.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "palpate/common/cancellation.h"
#include "palpate/mesh/cell_contents.h"
#include "palpate/mesh/edge_table.h"

namespace palpate {
namespace {

class Cutter {
 public:
  Cutter(const BccLattice& lattice, const TetrahedronSubdivision& cut, const InsideField& field, bool separate,
         const Bridges& bridges)
      : lattice_(lattice), cut_(cut), field_(field), separate_(separate), bridges_(bridges) {}

  SolidPieces run() {
    sampleAll();
    labelPieces();
    linkPieces();
    return std::move(result_);
  }

 private:
  /// In the order of the lattice, the lower cells of all tetrahedra that may hold solid.
  std::vector<BccLattice::Point> lowerCells(const CellContents& contents) const {
    std::vector<BccLattice::Point> out;
    const auto add = [&](BccLattice::Point c, int axis) {
      if (axis >= 0 && c[static_cast<size_t>(axis)]-- == 0) return;
      out.push_back(c);
    };
    for (const BccLattice::Point& c : contents.filled())
      for (int axis = -1; axis < 3; ++axis) add(c, axis);
    for (const auto& [tetrahedron, samples] : bridges_) out.push_back(lattice_.lowerCell(tetrahedron));
    std::sort(out.begin(), out.end(), [](const BccLattice::Point& a, const BccLattice::Point& b) {
      return std::tie(a[2], a[1], a[0]) < std::tie(b[2], b[1], b[0]);
    });
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
  }

  void sampleAll() {
    using Content = CellContents::Content;
    const CellContents contents(lattice_, field_);
    const auto& n = lattice_.cells();
    for (const BccLattice::Point& lower : lowerCells(contents)) {
      throwIfCancelled();
      const Content a = contents.at(lower);
      for (int axis = 0; axis < 3; ++axis) {
        BccLattice::Point upper = lower;
        if (++upper[static_cast<size_t>(axis)] >= n[static_cast<size_t>(axis)]) continue;
        const Content b = contents.at(upper);
        const bool empty = a == Content::outside && b == Content::outside;
        const bool whole = a == Content::inside && b == Content::inside;
        for (int edge = 0; edge < 4; ++edge) {
          const int64_t tetrahedron = lattice_.tetrahedron(lower, axis, edge);
          if (!empty || bridges_.count(tetrahedron) > 0) sample(tetrahedron, whole);
        }
      }
    }
  }

  void sample(int64_t tetrahedron, bool whole) {
    const auto count = static_cast<size_t>(cut_.count());
    const size_t base = result_.label.size();
    result_.label.resize(base + count, whole ? 0 : -1);
    bool any = whole;
    if (!whole) {
      const auto points = lattice_.points(tetrahedron);
      std::array<Vec3, 4> x;
      for (size_t k = 0; k < 4; ++k) x[k] = lattice_.position(points[k]);
      for (size_t s = 0; s < count; ++s) {
        const Vec4& w = cut_.centers()[s];
        if (!field_.inside(w[0] * x[0] + w[1] * x[1] + w[2] * x[2] + w[3] * x[3])) continue;
        result_.label[base + s] = 0;
        any = true;
      }
      if (const auto bridge = bridges_.find(tetrahedron); bridge != bridges_.end()) {
        for (const int s : bridge->second) result_.label[base + static_cast<size_t>(s)] = 0;
        any = true;
      }
    }
    if (!any) {
      result_.label.resize(base);
      return;
    }
    result_.slot_of[tetrahedron] = static_cast<int>(result_.tetrahedra.size());
    result_.tetrahedra.push_back(tetrahedron);
  }

  void labelPieces() {
    const int count = cut_.count();
    for (size_t slot = 0; slot < result_.tetrahedra.size(); ++slot) {
      throwIfCancelled();
      int* label = result_.label.data() + slot * static_cast<size_t>(count);
      DisjointSets sets(count);
      for (const auto& [a, b] : cut_.neighbors())
        if (label[a] >= 0 && label[b] >= 0) sets.unite(a, b);
      int only = -1;
      for (int s = 0; s < count; ++s) {
        if (label[s] < 0) continue;
        const int root = sets.find(s);
        int piece = root < s ? label[root] : (separate_ ? -1 : only);
        if (piece < 0) {
          piece = static_cast<int>(result_.pieces.size());
          result_.pieces.push_back({static_cast<int>(slot), 0, Vec4::Zero()});
        }
        only = piece;
        label[s] = piece;
        ++result_.pieces[static_cast<size_t>(piece)].samples;
        result_.pieces[static_cast<size_t>(piece)].moment += cut_.centers()[static_cast<size_t>(s)];
      }
    }
  }

  /// A face of a slot, its lattice points ascending, with the corners they are.
  struct Face {
    std::array<int64_t, 3> key;
    std::array<int, 3> corner;
    int slot;
    int opposite;
  };

  void linkPieces() {
    std::vector<Face> faces;
    faces.reserve(4 * result_.tetrahedra.size());
    for (size_t slot = 0; slot < result_.tetrahedra.size(); ++slot) {
      const auto points = lattice_.points(result_.tetrahedra[slot]);
      for (int opposite = 0; opposite < 4; ++opposite) {
        std::array<std::pair<int64_t, int>, 3> p;
        for (int k = 0, i = 0; k < 4; ++k)
          if (k != opposite) p[static_cast<size_t>(i++)] = {lattice_.pointIndex(points[static_cast<size_t>(k)]), k};
        std::sort(p.begin(), p.end());
        faces.push_back({{p[0].first, p[1].first, p[2].first},
                         {p[0].second, p[1].second, p[2].second},
                         static_cast<int>(slot),
                         opposite});
      }
    }
    std::sort(faces.begin(), faces.end(),
              [](const Face& a, const Face& b) { return std::tie(a.key, a.slot) < std::tie(b.key, b.slot); });
    for (size_t i = 1; i < faces.size(); ++i)
      if (faces[i].key == faces[i - 1].key) linkAcross(faces[i - 1], faces[i]);
  }

  void linkAcross(const Face& a, const Face& b) {
    throwIfCancelled();
    const auto width = static_cast<size_t>(3 * cut_.side() + 1);
    grid_.assign(width * width, -1);
    const auto place = [&](const Face& face, const TetrahedronSubdivision::FacePart& part) {
      return static_cast<size_t>(part.center[static_cast<size_t>(face.corner[0])]) * width +
             static_cast<size_t>(part.center[static_cast<size_t>(face.corner[1])]);
    };
    const auto labelOf = [&](const Face& face, int part) {
      return result_
          .label[static_cast<size_t>(face.slot) * static_cast<size_t>(cut_.count()) + static_cast<size_t>(part)];
    };
    for (const auto& part : cut_.face(static_cast<size_t>(a.opposite))) grid_[place(a, part)] = labelOf(a, part.part);
    std::set<std::pair<int, int>> touching;
    for (const auto& part : cut_.face(static_cast<size_t>(b.opposite))) {
      const int p = grid_[place(b, part)];
      const int q = labelOf(b, part.part);
      if (p >= 0 && q >= 0) touching.insert({p, q});
    }
    for (const auto& [p, q] : touching) {
      SolidPieces::Link link{p, q, {}};
      for (size_t k = 0; k < 3; ++k) link.corners[k] = {a.corner[k], b.corner[k]};
      result_.links.push_back(link);
    }
  }

  const BccLattice& lattice_;
  const TetrahedronSubdivision& cut_;
  const InsideField& field_;
  bool separate_;
  const Bridges& bridges_;
  SolidPieces result_;
  std::vector<int> grid_;
};

}  // namespace

SolidPieces cutSolid(const BccLattice& lattice, const TetrahedronSubdivision& cut, const InsideField& field,
                     bool separate, const Bridges& bridges) {
  return Cutter(lattice, cut, field, separate, bridges).run();
}

}  // namespace palpate
