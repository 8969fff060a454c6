#include "palpate/mesh/solid_pieces.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "palpate/mesh/edge_table.h"

namespace palpate {
namespace {

/// What the voxels say about each lattice cell, to skip most of the sampling.
struct CellContent {
  std::vector<char> solid;   ///< some voxel that overlaps the cell is not outside
  std::vector<char> hollow;  ///< some voxel that overlaps the cell is not inside
};

CellContent contentOf(const BccLattice& lattice, const InsideField& field) {
  const auto& n = lattice.cells();
  const size_t total = static_cast<size_t>(n[0]) * static_cast<size_t>(n[1]) * static_cast<size_t>(n[2]);
  CellContent content{std::vector<char>(total, 0), std::vector<char>(total, 0)};
  std::array<std::vector<std::array<int, 2>>, 3> range;
  for (size_t d = 0; d < 3; ++d)
    for (int i = 0; i < field.counts()[d]; ++i) {
      const auto e = static_cast<Eigen::Index>(d);
      const double low = (field.low()[e] + i * field.voxelSize() - lattice.origin()[e]) / lattice.cellSize();
      const double high = low + field.voxelSize() / lattice.cellSize();
      range[d].push_back({std::clamp(static_cast<int>(std::floor(low - 1e-9)), 0, n[d] - 1),
                          std::clamp(static_cast<int>(std::floor(high + 1e-9)), 0, n[d] - 1)});
    }
  for (int k = 0; k < field.counts()[2]; ++k)
    for (int j = 0; j < field.counts()[1]; ++j)
      for (int i = 0; i < field.counts()[0]; ++i) {
        const auto voxel = field.voxel(i, j, k);
        const auto &ri = range[0][static_cast<size_t>(i)], &rj = range[1][static_cast<size_t>(j)],
                   &rk = range[2][static_cast<size_t>(k)];
        for (int ck = rk[0]; ck <= rk[1]; ++ck)
          for (int cj = rj[0]; cj <= rj[1]; ++cj)
            for (int ci = ri[0]; ci <= ri[1]; ++ci) {
              const size_t c = static_cast<size_t>(ci) +
                               static_cast<size_t>(n[0]) *
                                   (static_cast<size_t>(cj) + static_cast<size_t>(n[1]) * static_cast<size_t>(ck));
              if (voxel != InsideField::Voxel::outside) content.solid[c] = 1;
              if (voxel != InsideField::Voxel::inside) content.hollow[c] = 1;
            }
      }
  return content;
}

class Cutter {
 public:
  Cutter(const BccLattice& lattice, const TetrahedronSubdivision& cut, const InsideField& field, bool separate,
         const std::vector<Vec3>& bridges)
      : lattice_(lattice), cut_(cut), field_(field), separate_(separate) {
    for (const Vec3& x : bridges) {
      const auto at = lattice_.locate(x);
      if (at.tetrahedron >= 0) bridges_[at.tetrahedron].push_back(cut_.locate(at.weights));
    }
  }

  SolidPieces run() {
    sampleAll();
    labelPieces();
    linkPieces();
    return std::move(result_);
  }

 private:
  void sampleAll() {
    const CellContent content = contentOf(lattice_, field_);
    const auto& n = lattice_.cells();
    BccLattice::Point c;
    const auto cell = [&](const BccLattice::Point& p) {
      return static_cast<size_t>(p[0]) +
             static_cast<size_t>(n[0]) *
                 (static_cast<size_t>(p[1]) + static_cast<size_t>(n[1]) * static_cast<size_t>(p[2]));
    };
    for (c[2] = 0; c[2] < n[2]; ++c[2])
      for (c[1] = 0; c[1] < n[1]; ++c[1])
        for (c[0] = 0; c[0] < n[0]; ++c[0])
          for (int axis = 0; axis < 3; ++axis) {
            BccLattice::Point upper = c;
            if (++upper[static_cast<size_t>(axis)] >= n[static_cast<size_t>(axis)]) continue;
            const size_t a = cell(c);
            const size_t b = cell(upper);
            if (!content.solid[a] && !content.solid[b]) continue;
            const bool whole = !content.hollow[a] && !content.hollow[b];
            for (int edge = 0; edge < 4; ++edge) sample(lattice_.tetrahedron(c, axis, edge), whole);
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
  std::unordered_map<int64_t, std::vector<int>> bridges_;  ///< samples, by tetrahedron
  SolidPieces result_;
  std::vector<int> grid_;
};

}  // namespace

SolidPieces cutSolid(const BccLattice& lattice, const TetrahedronSubdivision& cut, const InsideField& field,
                     bool separate, const std::vector<Vec3>& bridges) {
  return Cutter(lattice, cut, field, separate, bridges).run();
}

}  // namespace palpate
