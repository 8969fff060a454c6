#include "palpate/mesh/embed_surface.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <unordered_map>

#include "palpate/common/cancellation.h"
#include "palpate/common/error.h"
#include "palpate/mesh/mesh_quality.h"
#include "palpate/mesh/piece_mesh.h"
#include "palpate/mesh/refine_surface.h"
#include "palpate/mesh/simplify_surface.h"
#include "palpate/mesh/surface_seams.h"
#include "palpate/mesh/thickness.h"

namespace palpate {
namespace {

constexpr double kMostFilled = 4e6;  // cells that a lattice may have inside and on the surface
constexpr int kLargestTarget = 200'000;
constexpr int kMostTrials = 14;
// A search ends where this many tetrahedra, and this often the wanted number, would meet the solid: if the samples see
// far fewer then, it is too thin for them, and a finer lattice of a large sheet would take minutes to say the same.
constexpr double kMostMet = 20'000, kMostMetShare = 5;
constexpr int kSeamRounds = 8;
constexpr double kThinShare = 0.05;  // of the surface: what is thinner than this does not matter
constexpr double kOverlap = 2e-3;    // of the volume: less is within the error of sampling
constexpr double kThinnest = 30;     // cells by the thickness of a solid that a mesh follows for certain
constexpr int kLeastChosen = 300, kMostChosen = 20'000;

void requireOptions(const EmbedOptions& options) {
  if (options.target_tetrahedra < 0 || options.target_tetrahedra > kLargestTarget)
    throw InputError(options.name, "target_tetrahedra", "must be 1 to 200,000, or 0 to choose it");
  if (!(options.cell_size >= 0) || !std::isfinite(options.cell_size))
    throw InputError(options.name, "cell_size", "must be 0 (search) or positive, and finite");
  if (!(options.smallest_fill >= 0 && options.smallest_fill <= 0.5))
    throw InputError(options.name, "smallest_fill", "must be 0 to 0.5");
  if (options.surface_tolerance && !(*options.surface_tolerance >= 0))
    throw InputError(options.name, "surface_tolerance", "must not be negative");
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
                               const EmbedOptions& options, const Vec3& shift = Vec3::Zero(),
                               const Bridges& bridges = {}) {
  auto trial = std::make_unique<Trial>(latticeOver(box, cell, shift), subdivision);
  trial->shift = shift;
  trial->pieces.emplace(trial->lattice, trial->cut,
                        cutSolid(trial->lattice, trial->cut, field, options.virtual_nodes, bridges),
                        options.smallest_fill, options.virtual_nodes);
  return trial;
}

/// Twelve tetrahedra a cell in the volume and a layer of a third of a cell on the area.
double expectedCount(const SurfaceMeasures& solid, double cell) {
  return 12 * (solid.volume + solid.area * cell / 3) / (cell * cell * cell);
}

/// The cell that this count is expected with.
double cellFor(double count, const SurfaceMeasures& solid, const Bounds& box) {
  double low = 1e-6 * box.diagonal();
  double high = 10 * box.diagonal();
  for (int i = 0; i < 60; ++i) {
    const double a = std::sqrt(low * high);
    (expectedCount(solid, a) > count ? low : high) = a;
  }
  return low;
}

double smallestCell(const SurfaceMeasures& solid, const Bounds& box) {
  return std::max(cellFor(12 * kMostFilled, solid, box), box.diagonal() / 2000);
}

/// Searches the cell size for the wanted count, which falls as cells grow, though not steadily: bracketed secant steps
/// on logarithms. Where the count jumps past the target (a rod along the lattice), the lattice is shifted and searched
/// again.
class CellSearch {
 public:
  CellSearch(const InsideField& field, const SurfaceMeasures& solid, const Bounds& box, const EmbedOptions& options)
      : field_(field), box_(box), options_(options), first_(cellFor(options.target_tetrahedra, solid, box)) {
    const double most = std::max(kMostMet, kMostMetShare * options.target_tetrahedra);
    smallest_ = std::max(smallestCell(solid, box), cellFor(most, solid, box));
  }

  std::unique_ptr<Trial> run(int& trials) {
    for (const Vec3& shift : {Vec3(0, 0, 0), Vec3(0.25, 0.37, 0.31)}) {
      search(std::max(best_ ? best_->lattice.cellSize() : first_, smallest_), shift);
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
      next = std::max(next, smallest_);
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
  double first_, smallest_;
  std::unique_ptr<Trial> best_;
  double error_ = 0;
  int trials_ = 0;
};

class Assembly {
 public:
  /// @param overlapping  solids: the surface's integrals count some volume twice, the samples do not
  Assembly(Trial& trial, const Surface& surface, const SurfaceMeasures& solid, bool overlapping)
      : lattice_(trial.lattice), cut_(trial.cut), pieces_(*trial.pieces), solid_(solid) {
    makeTetrahedra();
    const Moments sampled = matched();
    sampled_volume_ = sampled.volume;
    if (overlapping) {
      solid_.volume = sampled.volume;
      solid_.center_of_mass += sampled.first / sampled.volume;
    } else {
      matchMass();
    }
    result_.surface = surface;
    embedVertices();
  }

  SimulationMesh take() { return std::move(result_); }
  double sampledVolume() const { return sampled_volume_; }
  const SurfaceMeasures& solid() const { return solid_; }

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

  void embedVertices() {
    const std::vector<Vec3> normals = vertexNormals(result_.surface);
    const PieceLocator locator(lattice_, cut_, pieces_);
    for (size_t v = 0; v < normals.size(); ++v) {
      throwIfCancelled();
      const Vec3& x = result_.surface.vertices[v];
      const int piece = locator.under(x, normals[v]);
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

/// Patches that bound solid: connected through edges, with positive volume.
int solidComponents(const Surface& capped) {
  DisjointSets sets(static_cast<int>(capped.triangles.size()));
  forEachEdge(edgeTable(capped), [&](const EdgeUse* first, const EdgeUse* last) {
    for (const EdgeUse* use = first; use != last; ++use) sets.unite(first->triangle, use->triangle);
  });
  const Vec3 center = boundsOf(capped.vertices).center();
  std::unordered_map<int, double> volume;
  for (size_t i = 0; i < capped.triangles.size(); ++i) {
    const auto& t = capped.triangles[i];
    const Vec3 a = capped.vertices[static_cast<size_t>(t[0])] - center;
    const Vec3 b = capped.vertices[static_cast<size_t>(t[1])] - center;
    const Vec3 c = capped.vertices[static_cast<size_t>(t[2])] - center;
    volume[sets.find(static_cast<int>(i))] += a.dot(b.cross(c)) / 6;
  }
  double total = 0;
  for (const auto& [root, v] : volume) total += v;
  int count = 0;
  for (const auto& [root, v] : volume) count += v > 1e-6 * total;
  return count;
}

/// Share of the volume that more than one of the surface's solids holds, by the winding number at samples.
double overlapShare(const Trial& trial, const InsideField& field) {
  constexpr size_t kSamples = 4000;
  const SolidPieces& solid = trial.pieces->solid();
  const auto count = static_cast<size_t>(trial.cut.count());
  const size_t stride = std::max<size_t>(1, solid.label.size() / kSamples) | 1;
  double held = 0;
  int points = 0;
  for (size_t i = 0; i < solid.label.size(); i += stride) {
    if (solid.label[i] < 0) continue;
    const auto corners = trial.lattice.points(solid.tetrahedra[i / count]);
    Vec3 x = Vec3::Zero();
    for (size_t k = 0; k < 4; ++k)
      x += trial.cut.centers()[i % count][static_cast<Eigen::Index>(k)] * trial.lattice.position(corners[k]);
    const double w = std::round(field.winding(x));
    if (w < 1) continue;
    held += w;
    ++points;
  }
  return points > 0 ? held / points - 1 : 0;
}

/// Stiffness of the node that is held least, of the median's. Of unit shear modulus: volume |gradient|^2, the part that
/// resists.
double softestNode(const SimulationMesh& mesh) {
  const std::vector<double> shares = resistingShares(mesh);
  std::vector<double> stiffness(mesh.mesh.nodes.size(), 0);
  for (size_t t = 0; t < mesh.fill.size(); ++t) {
    const auto& corner = mesh.mesh.tetrahedra[t];
    const double volume = tetrahedronVolume(mesh.mesh, corner);
    for (size_t k = 0; k < 4; ++k) {
      const Vec3& a = mesh.mesh.nodes[static_cast<size_t>(corner[(k + 1) % 4])];
      const Vec3& b = mesh.mesh.nodes[static_cast<size_t>(corner[(k + 2) % 4])];
      const Vec3& c = mesh.mesh.nodes[static_cast<size_t>(corner[(k + 3) % 4])];
      const double gradient = (b - a).cross(c - a).norm() / (6 * volume);
      stiffness[static_cast<size_t>(corner[k])] += shares[t] * volume * gradient * gradient;
    }
  }
  const double least = *std::min_element(stiffness.begin(), stiffness.end());
  const auto middle = stiffness.begin() + static_cast<std::ptrdiff_t>(stiffness.size() / 2);
  std::nth_element(stiffness.begin(), middle, stiffness.end());
  return least / *middle;
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
  report.components = quality.face_components;
  report.softest_node = softestNode(mesh);
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

/// About how many tetrahedra have cells as small as the solid is thick.
int countThatCarries(double thickness, const SurfaceMeasures& solid, const Bounds& box) {
  const double wanted = expectedCount(solid, std::max(thickness, smallestCell(solid, box)));
  return static_cast<int>(std::clamp<double>(wanted, kLeastChosen, kLargestTarget));
}

/// Why a thin solid has no mesh, and what would do.
std::string thinText(double thickness, const EmbedOptions& options, const SurfaceMeasures& solid, const Bounds& box) {
  // below what the thickness is measured from, a plate's
  if (!(thickness > 0)) thickness = 2 * solid.volume / solid.area;
  const auto thinnest = [&](double count) { return cellFor(count, solid, box) / kThinnest; };
  const double count = expectedCount(solid, std::max(kThinnest * thickness, 1e-9 * box.diagonal()));
  std::string text = fmt::format("is {:.2g} m thin, too little for a mesh of {} tetrahedra, which takes about {:.1g} m",
                                 thickness, options.target_tetrahedra, thinnest(options.target_tetrahedra));
  if (count <= kLargestTarget) return text + fmt::format("; ask for {:.0f} tetrahedra", std::ceil(count / 100) * 100);
  return text + fmt::format("; the most, {}, take {:.1g} m", kLargestTarget, thinnest(kLargestTarget));
}

/// Share of the places whose thickness is below a length.
double shareBelow(const std::vector<double>& thickness, double length) {
  if (thickness.empty()) return 0;
  const auto thin = std::lower_bound(thickness.begin(), thickness.end(), length);
  return static_cast<double>(thin - thickness.begin()) / static_cast<double>(thickness.size());
}

void requireCell(double cell, const SurfaceMeasures& solid, const Bounds& box, const std::string& name) {
  const double smallest = smallestCell(solid, box);
  if (cell >= smallest && cell <= 10 * box.diagonal()) return;
  throw InputError(name, "cell_size",
                   "must lie between " + std::to_string(smallest) + " and " + std::to_string(10 * box.diagonal()) +
                       " m for this surface");
}

void bridgeSeams(std::unique_ptr<Trial>& trial, const InsideField& field, const Surface& surface, const Bounds& box,
                 const EmbedOptions& options, EmbedReport& r) {
  const double cell = trial->lattice.cellSize(), sample = cell / trial->cut.side();
  Bridges bridges;
  const auto bridge = [&](const Vec3& x) {
    const auto at = trial->lattice.locate(x);
    if (at.tetrahedron >= 0) bridges[at.tetrahedron].insert(trial->cut.locate(at.weights));
  };
  r.bridges = 0;
  for (int round = 0; round < kSeamRounds; ++round) {
    const Seams seams = findSeams(surface, trial->lattice, trial->cut, *trial->pieces, 0.4 * sample);
    r.seams = seams.count;
    if (seams.count == 0 || round + 1 == kSeamRounds) break;
    r.bridges += seams.count;
    // thicker each time: samples that only touch at an edge do not hang together
    for (const Vec3& x : seams.bridges) {
      bridge(x);
      for (int d = 0; d < 6; ++d)
        for (int k = 1; k <= round + 1; ++k) bridge(x + (d < 3 ? 0.25 : -0.25) * k * sample * Vec3::Unit(d % 3));
    }
    trial = tryCell(field, box, cell, trial->cut.side(), options, trial->shift, bridges);
  }
}

/// Limbs thinner than the samples fall apart: samples more finely, then makes solid what the surface says is whole.
void closeSeams(std::unique_ptr<Trial>& trial, const InsideField& field, const Surface& surface, const Bounds& box,
                const EmbedOptions& options, EmbedReport& r) {
  const double cell = trial->lattice.cellSize();
  for (int finer : {12, 16}) {
    if (trial->pieces->components() <= r.solid_components || trial->cut.side() >= finer) continue;
    trial = tryCell(field, box, cell, finer, options, trial->shift);
  }
  for (const bool again : {false, true}) {
    bridgeSeams(trial, field, surface, box, options, r);
    if (again || trial->pieces->components() <= r.solid_components) break;
    // a sheet along the lattice's own planes: askew, another lattice meets it better
    trial = tryCell(field, box, cell, trial->cut.side(), options, trial->shift + Vec3(0.25, 0.37, 0.31));
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
  throwIfCancelled();
  RepairedSurface repaired = repairSurface(input);
  throwIfCancelled();
  const Surface& surface = repaired.surface;
  r.repair = repaired.report;
  requireSolid(surface, options.name);

  const Surface capped = capHoles(surface);
  const SurfaceMeasures solid = measureSurface(capped);
  const InsideField field(capped);
  const Bounds box = boundsOf(capped.vertices);
  const std::vector<double> thickness = solidThickness(surface, field);
  r.thickness = thicknessAt(thickness, kThinShare);
  r.suggested_tetrahedra = countThatCarries(r.thickness, solid, box);
  EmbedOptions chosen = options;
  if (options.target_tetrahedra == 0) chosen.target_tetrahedra = std::min(r.suggested_tetrahedra, kMostChosen);
  std::unique_ptr<Trial> trial;
  if (options.cell_size > 0) {
    requireCell(options.cell_size, solid, box, options.name);
    const double guess = expectedCount(solid, options.cell_size);
    trial = tryCell(field, box, options.cell_size, subdivisionFor(static_cast<int>(std::min(guess, 1e6))), options);
    r.trials = 1;
  } else {
    trial = CellSearch(field, solid, box, chosen).run(r.trials);
  }
  r.solid_components = solidComponents(capped);
  closeSeams(trial, field, surface, box, chosen, r);
  if (trial->pieces->count() == 0) throw InputError(options.name, "", thinText(r.thickness, chosen, solid, box));
  const int pieces = trial->pieces->components();
  if (pieces > r.solid_components)
    throw InputError(options.name, "",
                     "falls apart into " + std::to_string(pieces) + " pieces as a mesh of " +
                         std::to_string(trial->pieces->count()) + " tetrahedra: it " +
                         thinText(r.thickness, chosen, solid, box));

  throwIfCancelled();
  r.overlap_share = overlapShare(*trial, field);
  if (r.overlap_share < kOverlap) r.overlap_share = 0;
  // contact acts on the surface's vertices: no fewer than the mesh can follow
  const double cell = trial->lattice.cellSize();
  const double usual = std::min(kSurfaceTolerance * cell, kSurfaceToleranceOfSize * (box.high - box.low).norm());
  const SimplifiedSurface simplified = simplifySurface(surface, options.surface_tolerance.value_or(usual));
  r.given_triangles = static_cast<int>(surface.triangles.size());
  r.surface_deviation = simplified.deviation;
  const Surface refined = refineSurface(simplified.surface, cell);
  Assembly assembly(*trial, refined, solid, r.overlap_share > 0);
  throwIfCancelled();
  SimulationMesh mesh = assembly.take();
  r.sampled_volume = assembly.sampledVolume();
  r.cell_size = cell;
  r.subdivision = trial->cut.side();
  r.split_tetrahedra = splitTetrahedra(*trial->pieces);
  r.merged_slivers = trial->pieces->mergedSlivers();
  r.thin_share = shareBelow(thickness, r.cell_size);
  fillReport(mesh, assembly.solid(), r);
  r.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return mesh;
}

}  // namespace palpate
