#include "palpate/fem/elastic_mesh.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>

#include "palpate/common/error.h"
#include "palpate/common/parallel.h"
#include "palpate/fem/polar.h"
#include "palpate/math/rotation.h"
#include "palpate/mesh/mesh_quality.h"

namespace palpate {
namespace {

void checkElementMaterial(const ElementMaterial& m) {
  const auto positive = [](double value, const char* key) {
    if (!(value > 0) || !std::isfinite(value)) throw InputError("material", key, "must be positive and finite");
  };
  positive(m.youngs_modulus, "youngs_modulus");
  positive(m.density, "density");
  if (!(m.poisson_ratio > -1.0 && m.poisson_ratio < 0.5)) {
    throw InputError("material", "poisson_ratio", "must lie in (-1, 0.5)");
  }
}

void checkDamping(const Material& m) {
  if (!(m.damping_alpha >= 0 && m.damping_beta >= 0) || !std::isfinite(m.damping_alpha + m.damping_beta)) {
    throw InputError("material", "damping", "must be finite and not negative");
  }
}

// Columns x1 - x0, x2 - x0, x3 - x0 at rest; the determinant is six times the volume.
Mat3 restEdges(const SimulationMesh& mesh, int index) {
  const std::array<int, 4>& node = mesh.mesh.tetrahedra[index];
  Mat3 edges;
  for (int k = 0; k < 3; ++k) edges.col(k) = mesh.mesh.nodes[node[k + 1]] - mesh.mesh.nodes[node[0]];
  return edges;
}

ElasticElement makeElement(const SimulationMesh& mesh, int index, double share, const ElementMaterial& material) {
  ElasticElement e;
  e.node = mesh.mesh.tetrahedra[index];
  const Mat3 edges = restEdges(mesh, index);
  const double volume = edges.determinant() / 6.0;
  if (!(volume > 0) || !std::isfinite(volume)) {
    throw InputError("mesh", "tetrahedron " + std::to_string(index), "has no positive volume");
  }
  const Mat3 inverse = edges.inverse();
  for (int k = 0; k < 3; ++k) e.gradient[k + 1] = inverse.row(k).transpose();
  e.gradient[0] = -(e.gradient[1] + e.gradient[2] + e.gradient[3]);
  const double nu = material.poisson_ratio;
  const double filled = volume * share;
  e.lambda = filled * material.youngs_modulus * nu / ((1 + nu) * (1 - 2 * nu));
  e.mu = filled * material.youngs_modulus / (2 * (1 + nu));
  return e;
}

// By the linear law, with the stiffness scaled: K of the element's own moduli times scale.
ElementForces forcesOf(const ElasticElement& e, double scale, const Mat3& rotation, const Mat3& gradient) {
  const double mu = scale * e.mu, lambda = scale * e.lambda;
  const Mat3 g = rotation.transpose() * gradient;
  Mat3 strain = 0.5 * (g + g.transpose());
  strain.diagonal().array() -= 1.0;
  const double trace = strain.trace();
  Mat3 stress = 2.0 * mu * strain;
  stress.diagonal().array() += lambda * trace;
  ElementForces own;
  own.energy = mu * strain.squaredNorm() + 0.5 * lambda * trace * trace;
  own.thin = !isThick(g);
  const Mat3 p = rotation * stress;
  for (int k = 0; k < 4; ++k) own.force[k] = -p * e.gradient[k];
  return own;
}

constexpr double kLeastStretch = 0.1;  // of a sum of two: what is nearly flat has no stiffness from its stress

// The energy's curvature where g = R^T F turns against the identity: t_k / 2 about the principal directions V.
struct Turning {
  Mat3 directions;
  Vec3 stiffness;
};
Turning turningOf(const ElasticElement& e, const Mat3& g) {
  Eigen::SelfAdjointEigenSolver<Mat3> spectrum;
  spectrum.computeDirect(0.5 * (g + g.transpose()));
  const Vec3& s = spectrum.eigenvalues();
  const double swelling = e.lambda * (s.sum() - 3);
  Turning out{spectrum.eigenvectors(), {}};
  for (int k = 0; k < 3; ++k) {
    const double stretch = s[(k + 1) % 3] + s[(k + 2) % 3];
    out.stiffness[k] = stretch > kLeastStretch ? 0.5 * ((2 * e.mu * (stretch - 2) + 2 * swelling) / stretch) : 0.0;
  }
  return out;
}

// P = R V diag(sqrt(t_k / 2)); zero without tension.
Mat3 tensionFactor(const ElasticElement& e, const Mat3& rotation, const Mat3& gradient) {
  const Turning turning = turningOf(e, rotation.transpose() * gradient);
  const Vec3 root = turning.stiffness.cwiseMax(0.0).cwiseSqrt();
  if (root.isZero(0.0)) return Mat3::Zero();
  return rotation * turning.directions * root.asDiagonal();
}

// V diag(t_k / 2) V^T, of the matrix itself where none of its sums of stretches can be small.
Mat3 turningCurvature(const ElasticElement& e, const Mat3& g) {
  const Mat3 s = 0.5 * (g + g.transpose());
  const Mat3 sums = s.trace() * Mat3::Identity() - s;
  const Vec3 least = 2 * sums.diagonal() - sums.cwiseAbs().rowwise().sum();  // Gershgorin
  if (least.minCoeff() > kLeastStretch) {
    return e.mu * Mat3::Identity() + (e.lambda * (s.trace() - 3) - 2 * e.mu) * sums.inverse();
  }
  const Turning turning = turningOf(e, g);
  return turning.directions * turning.stiffness.asDiagonal() * turning.directions.transpose();
}

int partsFor(int elements) {
  constexpr int kLeast = 32, kMostParts = 32;
  return std::min(1 + elements / kLeast, kMostParts);
}

double energyOf(const std::vector<FlatElement>& flat, double scale) {
  double sum = 0;
  for (const FlatElement& own : flat) sum += scale * own.energy;
  return sum;
}

void add(const ElasticElement& e, const ElementForces& own, VecX& f) {
  for (int k = 0; k < 4; ++k) f.segment<3>(3 * e.node[k]) += own.force[k];
}

}  // namespace

std::vector<Vec3> elementCentroids(const TetrahedralMesh& mesh) {
  std::vector<Vec3> centroids;
  centroids.reserve(mesh.tetrahedra.size());
  for (const std::array<int, 4>& t : mesh.tetrahedra)
    centroids.push_back(0.25 * (mesh.nodes[t[0]] + mesh.nodes[t[1]] + mesh.nodes[t[2]] + mesh.nodes[t[3]]));
  return centroids;
}

ElasticMesh::ElasticMesh(const SimulationMesh& mesh, const Material& material) : ElasticMesh(mesh, material, {}) {}

ElasticMesh::ElasticMesh(const SimulationMesh& mesh, const Material& material,
                         const std::vector<ElementMaterial>& per_element)
    : material_(material), winding_(mesh.mesh) {
  const std::size_t count = mesh.mesh.tetrahedra.size();
  if (!per_element.empty() && per_element.size() != count)
    throw InputError("material", "",
                     std::to_string(per_element.size()) + " materials for " + std::to_string(count) + " tetrahedra");
  const ElementMaterial uniform{material.youngs_modulus, material.poisson_ratio, material.density};
  checkElementMaterial(uniform);
  checkDamping(material);
  mass_ = VecX::Zero(static_cast<Eigen::Index>(mesh.mesh.nodes.size()));
  elements_.reserve(count);
  const std::vector<double> shares = resistingShares(mesh);
  for (int i = 0; i < static_cast<int>(count); ++i) {
    const ElementMaterial& own = per_element.empty() ? uniform : per_element[i];
    if (!per_element.empty()) checkElementMaterial(own);
    elements_.push_back(makeElement(mesh, i, shares[i], own));
    const ElasticElement& e = elements_.back();
    const double volume = restEdges(mesh, i).determinant() / 6.0;
    for (int k = 0; k < 4; ++k) mass_[e.node[k]] += own.density * volume * mesh.share[i][k];
  }
  for (int n = 0; n < nodes(); ++n) {
    if (!(mass_[n] >= 0)) throw InputError("mesh", "node " + std::to_string(n), "has negative mass");
  }
}

ElasticState ElasticMesh::stateAt(const VecX& x) const {
  ElasticState state;
  state.rotations.assign(elements_.size(), Mat3::Identity());
  updateRotations(x, state);
  return state;
}

// Rotations of the elements from begin to end, four at once, each with its deformation gradient to visit(i, F).
template <class Visit>
void ElasticMesh::turnToFit(const VecX& x, int begin, int end, std::vector<Mat3>& rotations, Visit visit) const {
  std::array<Mat3, 4> gradient;
  std::array<Mat3*, 4> rotation{};
  for (int i = begin; i < end; i += 4) {
    const int count = std::min(4, end - i);
    for (int k = 0; k < count; ++k) {
      gradient[k] = elements_[i + k].deformationGradient(x);
      rotation[k] = &rotations[i + k];
    }
    polarRotations(gradient, rotation, count);
    for (int k = 0; k < count; ++k) visit(i + k, gradient[k]);
  }
}

void ElasticMesh::updateRotations(const VecX& x, ElasticState& state) const {
  std::vector<int> thin;
  turnToFit(x, 0, static_cast<int>(elements_.size()), state.rotations, [&](int i, const Mat3& gradient) {
    if (!isThick(state.rotations[i].transpose() * gradient)) thin.push_back(i);
  });
  updateReleased(x, thin, state.released);
  state.flat = flatOnes(x, thin, state.released, state.rotations);
}

// Those stay that are thin; those come that wind about an edge more than once.
void ElasticMesh::updateReleased(const VecX& x, const std::vector<int>& thin, std::vector<int>& released) const {
  if (thin.empty()) {
    released.clear();
    return;
  }
  std::vector<int> wound = released;
  for (const int t : thin) winding_.around(t, x, wound);
  std::sort(wound.begin(), wound.end());
  wound.erase(std::unique(wound.begin(), wound.end()), wound.end());
  released.clear();
  std::set_intersection(wound.begin(), wound.end(), thin.begin(), thin.end(), std::back_inserter(released));
}

std::vector<FlatElement> ElasticMesh::flatOnes(const VecX& x, const std::vector<int>& thin,
                                               const std::vector<int>& released,
                                               const std::vector<Mat3>& rotations) const {
  std::vector<FlatElement> flat;
  for (const int i : thin) {
    if (std::binary_search(released.begin(), released.end(), i)) continue;
    const ElasticElement& e = elements_[i];
    flat.emplace_back(i, rotations[i], rotations[i].transpose() * e.deformationGradient(x), e.lambda + 2 * e.mu);
  }
  return flat;
}

void ElasticMesh::addFlat(const std::vector<FlatElement>& flat, const std::vector<Mat3>& rotations, double scale,
                          VecX& f) const {
  for (const FlatElement& own : flat) {
    const ElasticElement& e = elements_[own.element];
    const Mat3 turned = own.frame.transpose() * rotations[own.element];
    const Mat3 p = scale * (own.frame * own.stress.asDiagonal() * turned);
    for (int k = 0; k < 4; ++k) f.segment<3>(3 * e.node[k]) -= p * e.gradient[k];
  }
}

void ElasticMesh::forces(const VecX& x, const ElasticState& state, VecX& f) const {
  f.setZero(3 * nodes());
  std::vector<int> thin;
  for (std::size_t i = 0; i < elements_.size(); ++i) {
    const ElasticElement& e = elements_[i];
    const ElementForces own = forcesOf(e, state.stiffness_scale, state.rotations[i], e.deformationGradient(x));
    add(e, own, f);
    if (own.thin) thin.push_back(static_cast<int>(i));
  }
  addFlat(flatOnes(x, thin, state.released, state.rotations), state.rotations, state.stiffness_scale, f);
}

double ElasticMesh::energy(const VecX& x, const ElasticState& state) const {
  double sum = 0;
  std::vector<int> thin;
  for (std::size_t i = 0; i < elements_.size(); ++i) {
    const ElasticElement& e = elements_[i];
    const ElementForces own = forcesOf(e, state.stiffness_scale, state.rotations[i], e.deformationGradient(x));
    sum += own.energy;
    if (own.thin) thin.push_back(static_cast<int>(i));
  }
  return sum + energyOf(flatOnes(x, thin, state.released, state.rotations), state.stiffness_scale);
}

double ElasticMesh::energyAt(const VecX& x, const ElasticState& state, ElasticAhead& ahead) const {
  double sum = 0;
  ahead.rotations.resize(elements_.size());
  ahead.element.resize(elements_.size());
  const int count = static_cast<int>(elements_.size());
  parallelRanges(partsFor(count), count, [&](int begin, int end) {
    std::copy(state.rotations.begin() + begin, state.rotations.begin() + end, ahead.rotations.begin() + begin);
    turnToFit(x, begin, end, ahead.rotations, [&](int i, const Mat3& gradient) {
      ahead.element[i] = forcesOf(elements_[i], state.stiffness_scale, ahead.rotations[i], gradient);
    });
  });
  ahead.forces.setZero(3 * nodes());
  ahead.thin.clear();
  for (int i = 0; i < count; ++i) {
    add(elements_[i], ahead.element[i], ahead.forces);
    sum += ahead.element[i].energy;
    if (ahead.element[i].thin) ahead.thin.push_back(i);
  }
  ahead.x = x;
  ahead.released = state.released;
  ahead.flat.clear();
  if (ahead.thin.empty() && ahead.released.empty()) return sum;
  ahead.flat = flatOnes(x, ahead.thin, state.released, ahead.rotations);
  sum += energyOf(ahead.flat, state.stiffness_scale);
  updateReleased(x, ahead.thin, ahead.released);
  if (ahead.released != state.released) ahead.flat = flatOnes(x, ahead.thin, ahead.released, ahead.rotations);
  addFlat(ahead.flat, ahead.rotations, state.stiffness_scale, ahead.forces);
  return sum;
}

SymmetricBlockMatrix ElasticMesh::pattern(const std::vector<int>& row) {
  int size = 0;
  std::vector<std::pair<int, int>> pairs;
  for (const int r : row) size = std::max(size, r + 1);
  for (const ElasticElement& e : elements_) {
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < i; ++j) {
        if (row[e.node[i]] >= 0 && row[e.node[j]] >= 0) pairs.emplace_back(row[e.node[i]], row[e.node[j]]);
      }
    }
  }
  SymmetricBlockMatrix a = SymmetricBlockMatrix::fromPairs(size, pairs);
  slots_.clear();
  slots_.reserve(elements_.size());
  for (const ElasticElement& e : elements_) {
    std::array<PairSlot, 10> entry;
    int n = 0;
    for (std::uint8_t i = 0; i < 4; ++i) {
      for (std::uint8_t j = 0; j <= i; ++j) {
        const int ri = row[e.node[i]];
        const int rj = row[e.node[j]];
        const bool present = ri >= 0 && rj >= 0;
        entry[n++] = {present ? a.find(std::max(ri, rj), std::min(ri, rj)) : -1, ri >= rj ? i : j, ri >= rj ? j : i};
      }
    }
    slots_.push_back(entry);
  }
  const int slots = static_cast<int>(a.values.size() / 9);
  for (int k = 0; k < kParts; ++k) {
    Part& part = parts_[k];
    part.first = partBegin(k, kParts, slots);
    part.end = partBegin(k + 1, kParts, slots);
    const auto within = [&](int slot) { return slot >= part.first && slot < part.end; };
    part.elements.clear();
    part.diagonal.clear();
    for (std::size_t n = 0; n < slots_.size(); ++n) {
      if (std::any_of(slots_[n].begin(), slots_[n].end(), [&](const PairSlot& s) { return within(s.slot); })) {
        part.elements.push_back(static_cast<int>(n));
      }
    }
    for (int node = 0; node < nodes(); ++node) {
      if (row[node] < 0) continue;
      const int slot = a.find(row[node], row[node]);
      if (within(slot)) part.diagonal.emplace_back(node, slot);
    }
  }
  return a;
}

void ElasticMesh::tensionFactors(const VecX& x, const ElasticState& state, double scale, std::vector<Mat3>& out) const {
  out.resize(elements_.size());
  const int count = static_cast<int>(elements_.size());
  parallelRanges(partsFor(count), count, [&](int begin, int end) {
    for (int n = begin; n < end; ++n) {
      out[n] = tensionFactor(elements_[n], state.rotations[n], elements_[n].deformationGradient(x));
      out[n] *= std::sqrt(scale);
    }
  });
}

MatX ElasticMesh::turningStiffness(const VecX& x, const ElasticState& state, const std::vector<int>& row,
                                   const MatX& shapes) const {
  using ByRows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  using Four = Eigen::Array4d;
  const Eigen::Index r = shapes.cols(), wide = (r + 3) / 4 * 4;
  if (r == 0) return MatX(0, 0);
  ByRows shape = ByRows::Zero(shapes.rows(), wide);
  shape.leftCols(r) = shapes;
  const int count = static_cast<int>(elements_.size()), parts = partsFor(count);
  std::vector<MatX> sums(static_cast<std::size_t>(parts));
  parallelFor(parts, [&](int part) {
    const int begin = partBegin(part, parts, count), end = partBegin(part + 1, parts, count);
    // of each element by each shape: the turn of F against R, and what it asks for
    ByRows turns(3 * (end - begin), wide), moments(3 * (end - begin), wide);
    std::array<Vec3, 12> lever;
    std::array<const double*, 12> values;
    for (int n = begin; n < end; ++n) {
      const ElasticElement& e = elements_[n];
      const Mat3 rt = state.rotations[n].transpose();
      const Mat3 curvature = state.stiffness_scale * turningCurvature(e, rt * e.deformationGradient(x));
      std::size_t levers = 0;
      for (int i = 0; i < 4; ++i) {
        if (row[e.node[i]] < 0) continue;
        const Mat3 own = skew(e.gradient[i]) * rt;
        for (int b = 0; b < 3; ++b, ++levers) {
          lever[levers] = own.col(b);
          values[levers] = shape.row(3 * row[e.node[i]] + b).data();
        }
      }
      const Eigen::Index at = 3 * (n - begin);
      for (Eigen::Index k = 0; k < wide; k += 4) {
        std::array<Four, 3> turn = {Four::Zero(), Four::Zero(), Four::Zero()};
        for (std::size_t j = 0; j < levers; ++j) {
          const Four value = Four::Map(values[j] + k);
          for (int a = 0; a < 3; ++a) turn[a] += lever[j][a] * value;
        }
        for (int a = 0; a < 3; ++a) {
          Four::Map(turns.row(at + a).data() + k) = turn[a];
          Four::Map(moments.row(at + a).data() + k) =
              curvature(a, 0) * turn[0] + curvature(a, 1) * turn[1] + curvature(a, 2) * turn[2];
        }
      }
    }
    sums[static_cast<std::size_t>(part)] = (turns.transpose() * moments).topLeftCorner(r, r);
  });
  MatX out = MatX::Zero(r, r);
  for (const MatX& sum : sums) out += sum;
  return out;
}

void ElasticMesh::assemble(double mass_scale, double stiffness_scale, const ElasticState& state,
                           SymmetricBlockMatrix& a, const std::vector<Mat3>& tension) const {
  for (int part = 0; part < kParts; ++part) assemblePart(part, mass_scale, stiffness_scale, state, a, tension);
}

void ElasticMesh::assemblePart(int index, double mass_scale, double stiffness_scale, const ElasticState& state,
                               SymmetricBlockMatrix& a, const std::vector<Mat3>& tension) const {
  const Part& part = parts_[index];
  const double scale = state.stiffness_scale * stiffness_scale;
  const auto entry = [&](int slot) { return a.values.begin() + 9 * static_cast<std::ptrdiff_t>(slot); };
  std::fill(entry(part.first), entry(part.end), 0.0);
  for (const auto& [node, slot] : part.diagonal) a.block(slot).diagonal().setConstant(mass_scale * mass_[node]);
  for (const int n : part.elements) {
    const ElasticElement& e = elements_[n];
    const std::array<Vec3, 4> c = e.rotatedGradients(state.rotations[n]);
    const bool tense = !tension.empty() && !tension[n].isZero(0.0);
    std::array<Mat3, 4> turning;  // B_i
    if (tense) {
      for (int k = 0; k < 4; ++k) turning[k] = skew(c[k]) * tension[n];
    }
    for (const PairSlot& s : slots_[n]) {
      if (s.slot < part.first || s.slot >= part.end) continue;
      a.block(s.slot) += scale * e.stiffness(c, s.i, s.j);
      if (tense) a.block(s.slot).noalias() += scale * (turning[s.i] * turning[s.j].transpose());
    }
  }
  for (const FlatElement& flat : state.flat) {
    const std::array<Vec3, 4> c = elements_[flat.element].rotatedGradients(state.rotations[flat.element]);
    std::array<FlatElement::Factor, 4> b;
    for (int k = 0; k < 4; ++k) b[k] = flat.factor(c[k]);
    for (const PairSlot& s : slots_[flat.element]) {
      if (s.slot < part.first || s.slot >= part.end) continue;
      a.block(s.slot).noalias() += scale * (b[s.i] * b[s.j].transpose());
    }
  }
}

}  // namespace palpate
