#include "palpate/mesh/embed_surface.h"

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <unordered_map>

#include "palpate/common/error.h"
#include "palpate/mesh/mesh_quality.h"
#include "palpate/mesh/piece_mesh.h"

namespace palpate {
namespace {

constexpr double kLargestLattice = 4e6;  // cells
constexpr int kLargestTarget = 200'000;
constexpr int kMostTrials = 14;

void requireOptions(const EmbedOptions& options) {
  if (options.target_tetrahedra < 1 || options.target_tetrahedra > kLargestTarget)
    throw InputError(options.name, "target_tetrahedra", "must be 1 to 200,000");
  if (!(options.cell_size >= 0) || !std::isfinite(options.cell_size))
    throw InputError(options.name, "cell_size", "must be 0 (search) or positive, and finite");
  if (!(options.smallest_fill >= 0 && options.smallest_fill <= 0.5))
    throw InputError(options.name, "smallest_fill", "must be 0 to 0.5");
  if (!(options.count_tolerance >= 0)) throw InputError(options.name, "count_tolerance", "must not be negative");
}

/// Fewer samples a tetrahedron the more tetrahedra there are: the surface is resolved about as finely.
int subdivisionFor(int tetrahedra) { return tetrahedra <= 1000 ? 8 : tetrahedra <= 6000 ? 6 : 4; }

/// One lattice over the solid and what came of it.
struct Trial {
  BccLattice lattice;
  TetrahedronSubdivision cut;
  std::optional<PieceMesh> pieces;
  Vec3 shift = Vec3::Zero();

  Trial(const BccLattice& l, int subdivision) : lattice(l), cut(subdivision) {}
};

/// @param shift  of the lattice against the box, in cells
BccLattice latticeOver(const Bounds& box, double cell, const Vec3& shift) {
  // Unshifted, a lattice corner at the box's center keeps a symmetric solid's mesh symmetric; a cell of margin all
  // around.
  std::array<int, 3> cells{};
  Vec3 origin;
  for (int d = 0; d < 3; ++d) {
    const int half = static_cast<int>(std::floor(0.5 * (box.high[d] - box.low[d]) / cell)) + 2;
    cells[static_cast<size_t>(d)] = 2 * half;
    origin[d] = box.center()[d] - (half + shift[d]) * cell;
  }
  return BccLattice(origin, cell, cells);
}

std::unique_ptr<Trial> tryCell(const InsideField& field, const Bounds& box, double cell, int subdivision,
                               const EmbedOptions& options, const Vec3& shift = Vec3::Zero()) {
  auto trial = std::make_unique<Trial>(latticeOver(box, cell, shift), subdivision);
  trial->shift = shift;
  trial->pieces.emplace(trial->lattice, trial->cut, cutSolid(trial->lattice, trial->cut, field, options.virtual_nodes),
                        options.smallest_fill, options.virtual_nodes);
  return trial;
}

double smallestCell(const Bounds& box) {
  const Vec3 extent = (box.high - box.low).cwiseMax(1e-3 * box.diagonal());
  return std::max(std::cbrt(extent.prod() / kLargestLattice), box.diagonal() / 2000);
}

/// Twelve tetrahedra a cell in the volume and a layer of a third of a cell on the area.
double expectedCount(const SurfaceMeasures& solid, double cell) {
  return 12 * (solid.volume + solid.area * cell / 3) / (cell * cell * cell);
}

/// Searches the cell size for the wanted count, which falls as cells grow, though not steadily: bracketed secant steps
/// on logarithms. Where the count jumps past the target (a rod along the lattice), the lattice is shifted and searched
/// again.
class CellSearch {
 public:
  CellSearch(const InsideField& field, const Bounds& box, const EmbedOptions& options)
      : field_(field), box_(box), options_(options) {}

  std::unique_ptr<Trial> run(const SurfaceMeasures& solid, int& trials) {
    double low = 1e-6 * box_.diagonal();
    double high = 10 * box_.diagonal();
    for (int i = 0; i < 60; ++i) {
      const double a = std::sqrt(low * high);
      (expectedCount(solid, a) > options_.target_tetrahedra ? low : high) = a;
    }
    for (const Vec3& shift : {Vec3(0, 0, 0), Vec3(0.25, 0.37, 0.31)}) {
      search(std::max(best_ ? best_->lattice.cellSize() : low, smallestCell(box_)), shift);
      if (error_ < 2 * options_.count_tolerance) break;
    }
    trials = trials_;
    return std::move(best_);
  }

 private:
  void search(double cell, const Vec3& shift) {
    double too_many = 0;
    double too_few = 0;
    for (int i = 0; i < kMostTrials; ++i) {
      const double ratio = attempt(cell, shift);
      if (error_ <= options_.count_tolerance) return;
      (ratio > 0 ? too_many : too_few) = cell;
      double next = cell * std::exp(ratio / 2.3);
      const bool bracketed = too_many > 0 && too_few > 0;
      const double low = std::min(too_many, too_few);
      const double high = std::max(too_many, too_few);
      if (bracketed && !(next > low * 1.0005 && next < high * 0.9995)) next = std::sqrt(low * high);
      next = std::max(next, smallestCell(box_));
      if (std::abs(next / cell - 1) < 1e-4 || (bracketed && high / low < 1.002)) return;
      cell = next;
    }
  }

  /// log(count / target), keeping the best.
  double attempt(double cell, const Vec3& shift) {
    auto trial = tryCell(field_, box_, cell, subdivisionFor(options_.target_tetrahedra), options_, shift);
    ++trials_;
    const double ratio =
        std::log(std::max(trial->pieces->count(), 1) / static_cast<double>(options_.target_tetrahedra));
    if (!best_ || std::abs(ratio) < error_) {
      error_ = std::abs(ratio);
      best_ = std::move(trial);
    }
    return ratio;
  }

  const InsideField& field_;
  Bounds box_;
  const EmbedOptions& options_;
  std::unique_ptr<Trial> best_;
  double error_ = 0;
  int trials_ = 0;
};

class Assembly {
 public:
  Assembly(Trial& trial, const Surface& surface, const SurfaceMeasures& solid)
      : lattice_(trial.lattice), cut_(trial.cut), pieces_(*trial.pieces), solid_(solid) {
    makeTetrahedra();
    sampled_volume_ = matched().volume;
    matchMass();
    result_.surface = surface;
    embedVertices();
  }

  SimulationMesh take() { return std::move(result_); }
  double sampledVolume() const { return sampled_volume_; }

 private:
  int64_t tetrahedronOf(int piece) const {
    return pieces_.solid().tetrahedra[static_cast<size_t>(pieces_.solid().pieces[static_cast<size_t>(piece)].slot)];
  }

  void makeTetrahedra() {
    std::unordered_map<int, int> node_of;
    for (int p : pieces_.kept()) {
      const auto& piece = pieces_.solid().pieces[static_cast<size_t>(p)];
      const auto points = lattice_.points(tetrahedronOf(p));
      std::array<int, 4> t{};
      std::array<double, 4> share{};
      for (int k = 0; k < 4; ++k) {
        const auto i = static_cast<size_t>(k);
        const auto [it, fresh] =
            node_of.try_emplace(pieces_.nodeClass(p, k), static_cast<int>(result_.mesh.nodes.size()));
        if (fresh) result_.mesh.nodes.push_back(lattice_.position(points[i]));
        t[i] = it->second;
        share[i] = piece.moment[k] / cut_.count();
      }
      tetrahedron_of_[p] = static_cast<int>(result_.mesh.tetrahedra.size());
      result_.mesh.tetrahedra.push_back(t);
      result_.share.push_back(share);
      result_.fill.push_back(0);
      setFill(result_.fill.size() - 1, 1);
    }
  }

  /// Scales a tetrahedron's share, not above completely filled.
  void setFill(size_t t, double factor) {
    double sum = 0;
    for (double s : result_.share[t]) sum += s;
    const double fill = std::min(sum * factor, 1.0);
    for (double& s : result_.share[t]) s *= fill / sum;
    result_.fill[t] = fill;
  }

  struct Moments {
    double volume = 0;
    Vec3 first = Vec3::Zero();
  };
  Vec3 centerOf(size_t t) const {
    Vec3 c = Vec3::Zero();
    for (size_t k = 0; k < 4; ++k)
      c += result_.share[t][k] / result_.fill[t] *
           result_.mesh.nodes[static_cast<size_t>(result_.mesh.tetrahedra[t][k])];
    return c;
  }
  Moments matched() const {
    Moments m;
    for (size_t t = 0; t < result_.fill.size(); ++t) {
      const double v = lattice_.tetrahedronVolume() * result_.fill[t];
      m.volume += v;
      m.first += v * (centerOf(t) - solid_.center_of_mass);
    }
    return m;
  }

  /// Reweights the partly filled tetrahedra by 1 + a + b . x, with a and b such that volume and center of mass become
  /// the surface's. Sampling leaves them within a percent, so the factors stay near 1.
  void matchMass() {
    const double size = std::cbrt(solid_.volume);
    for (int round = 0; round < 8; ++round) {
      const Moments now = matched();
      Vec4 wanted;
      wanted << solid_.volume - now.volume, -now.first / size;
      if (wanted.cwiseAbs().maxCoeff() < 1e-14 * solid_.volume) return;
      Eigen::Matrix4d system = Eigen::Matrix4d::Zero();
      std::vector<Vec4> basis(result_.fill.size(), Vec4::Zero());
      for (size_t t = 0; t < result_.fill.size(); ++t) {
        if (result_.fill[t] >= 1) continue;
        basis[t] << 1, (centerOf(t) - solid_.center_of_mass) / size;
        system += lattice_.tetrahedronVolume() * result_.fill[t] * basis[t] * basis[t].transpose();
      }
      const Vec4 factors = system.fullPivLu().solve(wanted);
      if (!factors.allFinite()) return;
      for (size_t t = 0; t < result_.fill.size(); ++t)
        if (result_.fill[t] < 1) setFill(t, std::clamp(1 + factors.dot(basis[t]), 0.5, 2.0));
    }
  }

  int pieceAt(const Vec3& x) const {
    const auto location = lattice_.locate(x);
    const auto slot = pieces_.solid().slot_of.find(location.tetrahedron);
    if (slot == pieces_.solid().slot_of.end()) return -1;
    const auto sample = static_cast<size_t>(slot->second) * static_cast<size_t>(cut_.count()) +
                        static_cast<size_t>(cut_.locate(location.weights));
    return pieces_.solid().label[sample];
  }

  /// The piece of solid just under a surface vertex; -1 if no sample near it lies inside.
  int pieceUnder(const Vec3& x, const Vec3& normal) const {
    const double fine = lattice_.cellSize() / cut_.side();
    for (double depth : {0.4, 0.2, 0.7, 0.0, 1.0, 1.5}) {
      const int piece = pieceAt(x - depth * fine * normal);
      if (piece >= 0) return piece;
    }
    for (double radius : {0.5, 1.0, 1.6, 2.5, 4.0}) {
      int best = -1;
      double most_inward = -2;
      for (int i = 0; i < 27; ++i) {
        const Vec3 direction = Vec3(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1).normalized();
        const int piece = pieceAt(x + radius * fine * direction);
        if (piece < 0 || -direction.dot(normal) <= most_inward) continue;
        most_inward = -direction.dot(normal);
        best = piece;
      }
      if (best >= 0) return best;
    }
    return -1;
  }

  void embedVertices() {
    const std::vector<Vec3> normals = vertexNormals(result_.surface);
    for (size_t v = 0; v < normals.size(); ++v) {
      const Vec3& x = result_.surface.vertices[v];
      const int piece = pieceUnder(x, normals[v]);
      result_.embedding.push_back(piece >= 0 ? embedNear(x, piece) : embedAnywhere(x));
    }
  }

  EmbeddedPoint embedIn(const Vec3& x, int kept) const {
    const Vec4 w = lattice_.weights(tetrahedronOf(kept), x);
    return {tetrahedron_of_.at(kept), {w[0], w[1], w[2], w[3]}};
  }
  double worstWeight(const Vec3& x, int kept) const { return lattice_.weights(tetrahedronOf(kept), x).minCoeff(); }

  /// In the piece or, where it does not reach the point, in the best of those that the solid connects it with.
  EmbeddedPoint embedNear(const Vec3& x, int piece) const {
    const int host = pieces_.hostOf(piece);
    int best = host;
    double best_weight = worstWeight(x, host);
    if (best_weight < -1e-9) {
      for (int other : pieces_.keptNeighbors(host)) {
        const double w = worstWeight(x, other);
        if (w <= best_weight) continue;
        best = other;
        best_weight = w;
      }
    }
    return embedIn(x, best);
  }

  EmbeddedPoint embedAnywhere(const Vec3& x) const {
    int best = pieces_.kept().front();
    double best_weight = worstWeight(x, best);
    for (int p : pieces_.kept()) {
      const double w = worstWeight(x, p);
      if (w <= best_weight) continue;
      best = p;
      best_weight = w;
    }
    return embedIn(x, best);
  }

  const BccLattice& lattice_;
  const TetrahedronSubdivision& cut_;
  PieceMesh& pieces_;
  SurfaceMeasures solid_;
  SimulationMesh result_;
  std::unordered_map<int, int> tetrahedron_of_;
  double sampled_volume_ = 0;
};

/// Patches that bound solid: connected by vertices, with positive volume.
int solidComponents(const Surface& surface) {
  DisjointSets sets(static_cast<int>(surface.vertices.size()));
  for (const auto& t : surface.triangles) {
    sets.unite(t[0], t[1]);
    sets.unite(t[0], t[2]);
  }
  const Surface capped = capHoles(surface);
  const Vec3 center = boundsOf(surface.vertices).center();
  std::unordered_map<int, double> volume;
  for (size_t i = 0; i < capped.triangles.size(); ++i) {
    const auto& t = capped.triangles[i];
    const Vec3 a = capped.vertices[static_cast<size_t>(t[0])] - center;
    const Vec3 b = capped.vertices[static_cast<size_t>(t[1])] - center;
    const Vec3 c = capped.vertices[static_cast<size_t>(t[2])] - center;
    volume[sets.find(t[0])] += a.dot(b.cross(c)) / 6;
  }
  double total = 0;
  for (const auto& [root, v] : volume) total += v;
  int count = 0;
  for (const auto& [root, v] : volume) count += v > 1e-6 * total;
  return count;
}

int splitTetrahedra(const PieceMesh& pieces) {
  std::unordered_map<int, int> copies;
  int split = 0;
  for (int p : pieces.kept()) split += ++copies[pieces.solid().pieces[static_cast<size_t>(p)].slot] == 2;
  return split;
}

void fillReport(const SimulationMesh& mesh, const SurfaceMeasures& solid, EmbedReport& report) {
  const TetrahedraQuality quality = measureQuality(mesh.mesh);
  report.tetrahedra = static_cast<int>(mesh.mesh.tetrahedra.size());
  report.nodes = static_cast<int>(mesh.mesh.nodes.size());
  report.components = quality.components;
  report.smallest_dihedral_deg = quality.smallest_dihedral_deg;
  report.worst_radius_ratio = quality.worst_radius_ratio;
  report.surface_volume = solid.volume;
  report.smallest_fill = *std::min_element(mesh.fill.begin(), mesh.fill.end());
  Vec3 first = Vec3::Zero();
  for (size_t t = 0; t < mesh.fill.size(); ++t) {
    const double v = tetrahedronVolume(mesh.mesh, mesh.mesh.tetrahedra[t]);
    report.mesh_volume += v * mesh.fill[t];
    for (size_t k = 0; k < 4; ++k)
      first += v * mesh.share[t][k] * mesh.mesh.nodes[static_cast<size_t>(mesh.mesh.tetrahedra[t][k])];
  }
  report.center_error = (first / report.mesh_volume - solid.center_of_mass).norm();
  report.smallest_weight = 1;
  for (const EmbeddedPoint& point : mesh.embedding) {
    const double w = *std::min_element(point.weights.begin(), point.weights.end());
    report.smallest_weight = std::min(report.smallest_weight, w);
    report.vertices_outside += w < -1e-9;
  }
}

}  // namespace

SimulationMesh embedSurface(const Surface& input, const EmbedOptions& options, EmbedReport* report) {
  const auto start = std::chrono::steady_clock::now();
  requireOptions(options);
  EmbedReport local;
  EmbedReport& r = report ? *report : local;
  r = EmbedReport{};
  for (const Vec3& x : input.vertices)
    if (!x.allFinite() || x.cwiseAbs().maxCoeff() > 1e9)
      throw InputError(options.name, "", "has a vertex that is not finite, or beyond 1e9 m");
  RepairedSurface repaired = repairSurface(input);
  const Surface& surface = repaired.surface;
  r.repair = repaired.report;
  requireSolid(surface, options.name);

  const Surface capped = capHoles(surface);
  const SurfaceMeasures solid = measureSurface(capped);
  const InsideField field(capped);
  const Bounds box = boundsOf(capped.vertices);
  std::unique_ptr<Trial> trial;
  if (options.cell_size > 0) {
    const double cell = options.cell_size;
    if (cell < smallestCell(box) || cell > 10 * box.diagonal())
      throw InputError(options.name, "cell_size",
                       "must lie between " + std::to_string(smallestCell(box)) + " and " +
                           std::to_string(10 * box.diagonal()) + " m for this surface");
    const double guess = expectedCount(solid, cell);
    trial = tryCell(field, box, cell, subdivisionFor(static_cast<int>(std::min(guess, 1e6))), options);
    r.trials = 1;
  } else {
    trial = CellSearch(field, box, options).run(solid, r.trials);
  }
  r.solid_components = solidComponents(surface);
  // Limbs thinner than the samples fall apart: sample more finely.
  for (int finer : {12, 16}) {
    if (trial->pieces->components() <= r.solid_components || trial->cut.side() >= finer) continue;
    trial = tryCell(field, box, trial->lattice.cellSize(), finer, options, trial->shift);
  }
  if (trial->pieces->count() == 0)
    throw InputError(options.name, "", "is too thin for a simulation mesh of this size: ask for more tetrahedra");

  Assembly assembly(*trial, surface, solid);
  SimulationMesh mesh = assembly.take();
  r.sampled_volume = assembly.sampledVolume();
  r.cell_size = trial->lattice.cellSize();
  r.subdivision = trial->cut.side();
  r.split_tetrahedra = splitTetrahedra(*trial->pieces);
  r.merged_slivers = trial->pieces->mergedSlivers();
  fillReport(mesh, solid, r);
  r.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return mesh;
}

}  // namespace palpate
