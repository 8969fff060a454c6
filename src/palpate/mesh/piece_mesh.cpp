#include "palpate/mesh/piece_mesh.h"

#include <algorithm>
#include <map>
#include <set>
#include <unordered_map>
#include <unordered_set>

#include "palpate/common/cancellation.h"
#include "palpate/mesh/face_table.h"

namespace palpate {
namespace {

// A sliver may go to a tetrahedron in which none of its points has a weight below this: the embedding then stays close
// to interpolation, and a contact force on the sliver does not turn into large opposite forces.
constexpr double kLowestWeight = -0.35;
// A mesh component smaller than this share of the solid is a sampling crumb.
constexpr double kCrumbShare = 1e-3;

}  // namespace

PieceMesh::PieceMesh(const BccLattice& lattice, const TetrahedronSubdivision& cut, SolidPieces solid,
                     double smallest_fill, bool virtual_nodes)
    : lattice_(lattice),
      cut_(cut),
      solid_(std::move(solid)),
      classes_(4 * static_cast<int>(solid_.pieces.size())),
      host_(solid_.pieces.size()),
      adjacent_(solid_.pieces.size()),
      absorbed_(solid_.pieces.size()) {
  for (size_t p = 0; p < host_.size(); ++p) host_[p] = static_cast<int>(p);
  uniteCorners(virtual_nodes);
  throwIfCancelled();
  mergeIdentical();
  throwIfCancelled();
  findFaces();
  mergeSlivers(smallest_fill);
  dropCrumbs();
  for (size_t p = 0; p < host_.size(); ++p)
    if (isKept(static_cast<int>(p))) kept_.push_back(static_cast<int>(p));
}

int PieceMesh::hostOf(int piece) const {
  while (!isKept(piece)) piece = host_[static_cast<size_t>(piece)];
  return piece;
}

void PieceMesh::uniteCorners(bool virtual_nodes) {
  for (const auto& link : solid_.links)
    for (const auto& [a, b] : link.corners) classes_.unite(4 * link.piece + a, 4 * link.other + b);
  if (virtual_nodes) return;
  std::unordered_map<int64_t, int> first;
  for (size_t p = 0; p < solid_.pieces.size(); ++p) {
    const auto points = lattice_.points(tetrahedronOf(static_cast<int>(p)));
    for (int k = 0; k < 4; ++k) {
      const int corner = 4 * static_cast<int>(p) + k;
      const auto [it, fresh] = first.try_emplace(lattice_.pointIndex(points[static_cast<size_t>(k)]), corner);
      if (!fresh) classes_.unite(it->second, corner);
    }
  }
}

void PieceMesh::mergeIdentical() {
  std::map<std::array<int, 5>, int> seen;
  for (int p = 0; p < static_cast<int>(host_.size()); ++p) {
    const auto [it, fresh] = seen.try_emplace({solid_.pieces[static_cast<size_t>(p)].slot, nodeClass(p, 0),
                                               nodeClass(p, 1), nodeClass(p, 2), nodeClass(p, 3)},
                                              p);
    if (!fresh) absorb(p, it->second);
  }
}

// By nodes, not by links: what a piece that is given away was linked with need not touch its host.
void PieceMesh::findFaces() {
  std::vector<int> pieces;
  std::vector<std::array<int, 4>> corners;
  for (int p = 0; p < static_cast<int>(host_.size()); ++p) {
    if (!isKept(p)) continue;
    pieces.push_back(p);
    corners.push_back({nodeClass(p, 0), nodeClass(p, 1), nodeClass(p, 2), nodeClass(p, 3)});
  }
  const std::vector<FaceUse> faces = faceTable(corners);
  for (size_t i = 0; i < faces.size(); ++i)
    for (size_t j = i + 1; j < faces.size() && faces[j].first == faces[i].first; ++j) {
      const int a = pieces[static_cast<size_t>(faces[i].second)], b = pieces[static_cast<size_t>(faces[j].second)];
      adjacent_[static_cast<size_t>(a)].push_back(b);
      adjacent_[static_cast<size_t>(b)].push_back(a);
    }
}

void PieceMesh::absorb(int piece, int host) {
  auto& from = solid_.pieces[static_cast<size_t>(piece)];
  auto& to = solid_.pieces[static_cast<size_t>(host)];
  if (from.slot == to.slot) {
    to.moment += from.moment;
  } else {
    // Same mass at the same center, in the host's coordinates; what would be negative goes to the other corners.
    const auto points = lattice_.points(tetrahedronOf(piece));
    Vec3 center = Vec3::Zero();
    for (size_t k = 0; k < 4; ++k)
      center += from.moment[static_cast<Eigen::Index>(k)] / from.samples * lattice_.position(points[k]);
    Vec4 w = lattice_.weights(tetrahedronOf(host), center).cwiseMax(0.0);
    to.moment += from.samples * w / w.sum();
  }
  to.samples += from.samples;
  host_[static_cast<size_t>(piece)] = host;
  auto& list = absorbed_[static_cast<size_t>(host)];
  list.push_back(piece);
  auto& old = absorbed_[static_cast<size_t>(piece)];
  list.insert(list.end(), old.begin(), old.end());
  old.clear();
}

std::vector<int> PieceMesh::keptNeighbors(int piece) const {
  std::set<int> neighbors;
  for (int other : adjacent_[static_cast<size_t>(piece)])
    if (isKept(other)) neighbors.insert(other);
  return {neighbors.begin(), neighbors.end()};
}

bool PieceMesh::reaches(int piece, const std::vector<int>& others, int faces, int without) const {
  const auto all = [&](const std::set<int>& reached) {
    return std::all_of(others.begin(), others.end(), [&](int n) { return reached.count(n) > 0; });
  };
  std::set<int> reached = {piece};
  std::vector<int> front = {piece};
  for (int round = 0; round < faces && !front.empty() && !all(reached); ++round) {
    std::vector<int> next;
    for (int p : front)
      for (int n : adjacent_[static_cast<size_t>(p)])
        if (n != without && isKept(n) && reached.insert(n).second) next.push_back(n);
    front = std::move(next);
  }
  return all(reached);
}

bool PieceMesh::connectedNear(int piece, int other, int faces) const { return reaches(piece, {other}, faces, -1); }

void PieceMesh::mergeSlivers(double smallest_fill) {
  const double limit = smallest_fill * cut_.count();
  std::vector<int> small;
  std::unordered_set<int> held;  // nodes of the others
  for (int p = 0; p < static_cast<int>(host_.size()); ++p) {
    if (!isKept(p)) continue;
    if (solid_.pieces[static_cast<size_t>(p)].samples < limit) {
      small.push_back(p);
    } else {
      for (int k = 0; k < 4; ++k) held.insert(nodeClass(p, k));
    }
  }
  std::stable_sort(small.begin(), small.end(), [&](int a, int b) {
    return solid_.pieces[static_cast<size_t>(a)].samples < solid_.pieces[static_cast<size_t>(b)].samples;
  });
  for (int p : small) {
    throwIfCancelled();
    if (!isKept(p) || solid_.pieces[static_cast<size_t>(p)].samples >= limit) continue;
    bool adds_node = false;
    for (int k = 0; k < 4; ++k) adds_node = adds_node || held.count(nodeClass(p, k)) == 0;
    if (!adds_node) continue;
    merged_slivers_ += giveAway(p);
  }
}

bool PieceMesh::giveAway(int piece) {
  const std::vector<int> neighbors = keptNeighbors(piece);
  if (neighbors.empty()) return false;
  std::set<int> candidates(neighbors.begin(), neighbors.end());
  for (int n : neighbors)
    for (int far : keptNeighbors(n)) candidates.insert(far);
  candidates.erase(piece);
  int best = -1;
  double best_weight = kLowestWeight;
  for (int c : candidates) {
    const double w = worstWeight(piece, c);
    if (w <= best_weight) continue;
    best = c;
    best_weight = w;
  }
  if (best < 0 || !staysConnected(piece, neighbors)) return false;
  absorb(piece, best);
  return true;
}

double PieceMesh::worstWeight(int piece, int host) const {
  double worst = 1;
  std::vector<int> members = absorbed_[static_cast<size_t>(piece)];
  members.push_back(piece);
  for (int member : members) {
    const int slot = solid_.pieces[static_cast<size_t>(member)].slot;
    const auto points = lattice_.points(solid_.tetrahedra[static_cast<size_t>(slot)]);
    Eigen::Matrix4d corner_weights;
    for (size_t k = 0; k < 4; ++k)
      corner_weights.col(static_cast<Eigen::Index>(k)) =
          lattice_.weights(tetrahedronOf(host), lattice_.position(points[k]));
    for (int s = 0; s < cut_.count(); ++s) {
      if (solid_.label[static_cast<size_t>(slot) * static_cast<size_t>(cut_.count()) + static_cast<size_t>(s)] !=
          member)
        continue;
      worst = std::min(worst, (corner_weights * cut_.centers()[static_cast<size_t>(s)]).minCoeff());
    }
  }
  return worst;
}

bool PieceMesh::staysConnected(int piece, const std::vector<int>& neighbors) const {
  // Among pieces within eight faces of here: a longer way round would leave a hinge.
  return neighbors.empty() || reaches(neighbors.front(), neighbors, 8, piece);
}

DisjointSets PieceMesh::faceComponents() const {
  DisjointSets sets(static_cast<int>(host_.size()));
  for (int p = 0; p < static_cast<int>(host_.size()); ++p) {
    if (!isKept(p)) continue;
    for (int other : adjacent_[static_cast<size_t>(p)])
      if (isKept(other)) sets.unite(p, other);
  }
  return sets;
}

int PieceMesh::components() const {
  DisjointSets sets = faceComponents();
  std::set<int> roots;
  for (int p : kept_) roots.insert(sets.find(p));
  return static_cast<int>(roots.size());
}

void PieceMesh::dropCrumbs() {
  DisjointSets sets = faceComponents();
  std::map<int, long long> size;
  long long total = 0;
  const auto kept_pieces = [&](auto visit) {
    for (int p = 0; p < static_cast<int>(host_.size()); ++p)
      if (isKept(p)) visit(p);
  };
  kept_pieces([&](int p) {
    size[sets.find(p)] += solid_.pieces[static_cast<size_t>(p)].samples;
    total += solid_.pieces[static_cast<size_t>(p)].samples;
  });
  if (size.size() <= 1) return;
  std::vector<int> crumbs;
  std::vector<int> rest;
  kept_pieces([&](int p) {
    const bool crumb = static_cast<double>(size[sets.find(p)]) < kCrumbShare * static_cast<double>(total);
    (crumb ? crumbs : rest).push_back(p);
  });
  if (rest.empty()) return;
  for (int p : crumbs) {
    throwIfCancelled();
    int best = rest.front();
    double best_weight = -1e300;
    const auto points = lattice_.points(tetrahedronOf(p));
    const Vec3 center = 0.25 * (lattice_.position(points[0]) + lattice_.position(points[1]) +
                                lattice_.position(points[2]) + lattice_.position(points[3]));
    for (int r : rest) {
      const double w = lattice_.weights(tetrahedronOf(r), center).minCoeff();
      if (w > best_weight) {
        best = r;
        best_weight = w;
      }
    }
    absorb(p, best);
    ++merged_slivers_;
  }
}

}  // namespace palpate
