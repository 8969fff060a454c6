#include "palpate/reduction/partner_reduction.h"

#include <algorithm>
#include <utility>

#include "palpate/linear/dense_cholesky.h"
#include "palpate/math/decompositions.h"
#include "palpate/reduction/farthest_first.h"
#include "palpate/reduction/modes.h"

namespace palpate {
namespace {

// Of a system: the free nodes' velocities, then the frame's twist.
Eigen::Index unknowns(const BodyModel& model) { return 3 * model.freeNodes() + (model.framed() ? 6 : 0); }

// Columns <- A^-1 columns.
void solve(BodySystem& system, MatX& columns) {
  const Eigen::Index n = 3 * system.model().freeNodes();
  if (!system.model().framed()) {
    if (n > 0) system.factor().solve(columns);
    return;
  }
  MatX twist = columns.bottomRows<6>();
  if (n > 0) {
    MatX free = columns.topRows(n);
    twist -= system.response().transpose() * free;
    system.factor().solve(free);
    columns.topRows(n) = free;
  }
  twist = (system.handleSchurInverse() * twist).eval();
  columns.bottomRows<6>() = twist;
  if (n > 0) columns.topRows(n) -= system.response() * twist;
}

// A sum's three rows of J times columns.
Eigen::Matrix<double, 3, Eigen::Dynamic> applied(const BodySystem& system, const NodeSum& sum, const MatX& columns) {
  const BodyModel& model = system.model();
  Eigen::Matrix<double, 3, Eigen::Dynamic> out(3, columns.cols());
  out.setZero();
  for (const auto& [node, weight] : sum.nodes) {
    const int row = model.row()[node];
    if (row >= 0) {
      out += weight * columns.middleRows<3>(3 * row);
    } else if (!model.isFixed(node)) {
      out +=
          weight * model.handle().jacobian(model.attachedIndex()[node], system.startPose()) * columns.bottomRows<6>();
    }
  }
  return out;
}

// J^T of a sum times forces on it, one a column, is added to loads.
template <class Forces, class Loads>
void addLoads(const BodySystem& system, const NodeSum& sum, const Forces& forces, Loads&& loads) {
  const BodyModel& model = system.model();
  for (const auto& [node, weight] : sum.nodes) {
    const int row = model.row()[node];
    if (row >= 0) {
      loads.template middleRows<3>(3 * row) += weight * forces;
    } else if (!model.isFixed(node)) {
      loads.template bottomRows<6>() +=
          weight * model.handle().jacobian(model.attachedIndex()[node], system.startPose()).transpose() * forces;
    }
  }
}

// J^T of sums, three columns each.
MatX loadsOf(const BodySystem& system, const std::vector<NodeSum>& sums) {
  MatX columns = MatX::Zero(unknowns(system.model()), static_cast<Eigen::Index>(3 * sums.size()));
  for (std::size_t k = 0; k < sums.size(); ++k) {
    addLoads(system, sums[k], Mat3(Mat3::Identity()), columns.middleCols<3>(static_cast<Eigen::Index>(3 * k)));
  }
  return columns;
}

// J times columns.
MatX motionsOf(const BodySystem& system, const std::vector<NodeSum>& sums, const MatX& columns) {
  MatX out(static_cast<Eigen::Index>(3 * sums.size()), columns.cols());
  for (std::size_t k = 0; k < sums.size(); ++k) {
    out.middleRows<3>(static_cast<Eigen::Index>(3 * k)) = applied(system, sums[k], columns);
  }
  return out;
}

// J^T of sums, of a body without a frame.
BlockColumns columnsOf(const BodySystem& system, const std::vector<NodeSum>& sums) {
  BlockColumns columns;
  for (const NodeSum& sum : sums) {
    for (const auto& [node, weight] : sum.nodes) {
      const int row = system.model().row()[node];
      if (row >= 0) columns.add(row, weight * Mat3::Identity());
    }
    columns.close();
  }
  return columns;
}

// Q A^-1 J^T, Q of all sums of nodes and J of some.
MatX between(BodySystem& system, const std::vector<NodeSum>& all, const std::vector<NodeSum>& some) {
  if (system.model().framed()) {
    MatX columns = loadsOf(system, some);
    solve(system, columns);
    return motionsOf(system, all, columns);
  }
  MatX out;
  system.factor().between(columnsOf(system, all), columnsOf(system, some), out);
  return out;
}

// J A^-1 J^T over sums of nodes, lower triangle: by half of a solve, where there are no other rows.
MatX lowerGram(BodySystem& system, const std::vector<NodeSum>& sums) {
  if (system.model().framed()) {
    const MatX out = between(system, sums, sums);
    return 0.5 * (out + out.transpose());
  }
  MatX out;
  system.factor().gram(columnsOf(system, sums), out);
  return out;
}

// Of the last rows' diagonal: what says the same twice does no harm.
template <class Block>
void shiftDiagonal(Block&& held) {
  held.diagonal().array() += 1e-6 * held.diagonal().mean();
}

// Leaves of W, its lower triangle, the first rows, with all others held.
MatX tied(const MatX& w, Eigen::Index m) {
  const Eigen::Index ties = w.rows() - m;
  MatX held = w.bottomRightCorner(ties, ties), half = w.bottomLeftCorner(ties, m);
  shiftDiagonal(held);
  MatX own = w.topLeftCorner(m, m).selfadjointView<Eigen::Lower>();
  if (!choleskyInPlace(held)) return own;
  held.triangularView<Eigen::Lower>().solveInPlace(half);
  own -= half.transpose() * half;
  return own;
}

NodeSum nodesOf(const ContactPoint& point, double sign) {
  NodeSum out;
  for (int k = 0; k < point.count; ++k) out.nodes.emplace_back(point.node[k], sign * point.weight[k]);
  return out;
}

bool involves(const Contact& c, int body) { return c.first.body == body || c.second.body == body; }

// -1: what is fixed.
int otherBody(const Contact& c, int body) { return c.first.body == body ? c.second.body : c.first.body; }

// Bodies that loaded glue joins to this one, itself first, without the tool.
std::vector<int> gluedTo(const std::vector<Contact>& loaded, int body, int tool) {
  std::vector<int> out{body};
  for (std::size_t k = 0; k < out.size(); ++k) {
    for (const Contact& c : loaded) {
      if (!c.glued() || !involves(c, out[k]) || involves(c, tool)) continue;
      const int other = otherBody(c, out[k]);
      if (std::find(out.begin(), out.end(), other) == out.end()) out.push_back(other);
    }
  }
  return out;
}

// What holds a body besides the tool: a loaded contact, all three rows where it sticks, its normal where it slides.
struct Tie {
  const Contact* contact;
  Vec3 force;  // on the contact's first point [N]
  bool slides;
  Eigen::Index rows() const { return slides ? 1 : 3; }
  // A column for each of its rows: the first ones of the contact's own.
  Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, 3> axes() const {
    return contact->frame().transpose().leftCols(rows());
  }
};

constexpr double kSlides = 1e-3;  // [m/s]: friction at its limit alone may also be a strain that nothing undoes

// Along the surfaces [m/s].
double slip(const World& world, const Contact& c) {
  Vec3 v = Vec3::Zero();
  if (c.first.body >= 0) v += c.first.at(world.body(c.first.body).state.velocities);
  if (c.second.body >= 0) v -= c.second.at(world.body(c.second.body).state.velocities);
  return (v - c.normal.dot(v) * c.normal).norm();
}

std::vector<Tie> tiesOf(const World& world, const std::vector<int>& bodies, bool supported = false) {
  std::vector<Tie> ties;
  const ContactMemory& memory = world.state().contacts;
  for (std::size_t k = 0; k < memory.loaded.size(); ++k) {
    const Contact& c = memory.loaded[k];
    if (involves(c, world.toolIndex())) continue;
    if (std::none_of(bodies.begin(), bodies.end(), [&](int b) { return involves(c, b); })) continue;
    const bool moves = memory.find(c.track) != nullptr && memory.find(c.track)->status.state > ContactState::stick &&
                       slip(world, c) > kSlides;
    const bool slides = !c.glued() && (supported || moves);
    ties.push_back({&c, memory.loadedForce(k), slides});
  }
  return ties;
}

constexpr std::size_t kMostBeside = 8;  // what is farther from the tool than so many bodies stands still

// Adds the bodies that loaded contacts join to these, but for the tool and one more.
// @returns whether what stands still holds them, by more than the normals of what slides on it
bool addTouched(const World& world, int left_out, std::vector<int>& bodies) {
  bool held = false;
  for (std::size_t k = 0; k < bodies.size(); ++k) {
    held = held || !world.body(bodies[k]).model.attachments().empty();
    for (const Tie& t : tiesOf(world, {bodies[k]})) {
      const Contact& c = *t.contact;
      if (left_out >= 0 && involves(c, left_out)) continue;
      const int other = otherBody(c, bodies[k]);
      if (other >= 0 && std::find(bodies.begin(), bodies.end(), other) != bodies.end()) continue;
      if (other >= 0 && bodies.size() < kMostBeside) {
        bodies.push_back(other);
      } else {
        held = held || !t.slides;
      }
    }
  }
  return held;
}

Eigen::Index rowsOf(const std::vector<Tie>& ties) {
  Eigen::Index rows = 0;
  for (const Tie& t : ties) rows += t.rows();
  return rows;
}

// The body's own side of a tie, or both.
NodeSum nodesOf(const Contact& c, int body) {
  NodeSum out;
  if (c.first.body == body) out = nodesOf(c.first, 1.0);
  if (c.second.body != body) return out;
  const NodeSum second = nodesOf(c.second, -1.0);
  out.nodes.insert(out.nodes.end(), second.nodes.begin(), second.nodes.end());
  return out;
}

// Of the Gram matrix of sums and of three rows for each tie the sums' rows and those that hold; lower triangles.
MatX holding(const MatX& gram, Eigen::Index own, const std::vector<Tie>& ties) {
  const Eigen::Index size = own + rowsOf(ties);
  MatX out(size, size);
  out.topLeftCorner(own, own) = gram.topLeftCorner(own, own);
  Eigen::Index row = own;
  for (std::size_t i = 0; i < ties.size(); ++i) {
    const auto axes = ties[i].axes();
    const Eigen::Index rows = axes.cols(), from = own + static_cast<Eigen::Index>(3 * i);
    out.block(row, 0, rows, own) = axes.transpose() * gram.block(from, 0, 3, own);
    Eigen::Index column = own;
    for (std::size_t j = 0; j < i; ++j) {
      const Mat3 between = gram.block<3, 3>(from, own + static_cast<Eigen::Index>(3 * j));
      const auto others = ties[j].axes();
      out.block(row, column, rows, others.cols()) = axes.transpose() * (between * others).eval();
      column += others.cols();
    }
    const Mat3 self = gram.block<3, 3>(from, from).selfadjointView<Eigen::Lower>();
    out.block(row, row, rows, rows) = axes.transpose() * (self * axes).eval();
    row += rows;
  }
  return out;
}

// Over several bodies, of sums of the first one's nodes and of three rows for each tie; lower triangle.
// @param scale  h (h + beta) of what each one's own is divided by; 0: nothing is scaled
MatX lowerGram(World& world, const std::vector<int>& bodies, const std::vector<NodeSum>& sums,
               const std::vector<Tie>& ties, double scale) {
  const auto size = static_cast<Eigen::Index>(3 * (sums.size() + ties.size()));
  MatX w = MatX::Zero(size, size);
  for (const int b : bodies) {
    std::vector<NodeSum> rows(sums.size());
    if (b == bodies.front()) rows = sums;
    for (const Tie& t : ties) rows.push_back(nodesOf(*t.contact, b));
    BodySystem& system = world.body(b).system;
    w.triangularView<Eigen::Lower>() += (scale > 0 ? system.stiffnessScale() / scale : 1.0) * lowerGram(system, rows);
  }
  return w;
}

// Of several bodies that are glued: their own, the joints' rows and those of what else they touch held at zero [m/N].
MatX gluedCompliance(World& world, const std::vector<int>& bodies, const std::vector<NodeSum>& sums) {
  const std::vector<Tie> ties = tiesOf(world, bodies);
  const auto own = static_cast<Eigen::Index>(3 * sums.size());
  return tied(holding(lowerGram(world, bodies, sums, ties, 1.0), own, ties), own);
}

// Bodies beside a touched one that its ties join to it and loaded contacts to each other: they yield as it moves them.
struct Beside {
  std::vector<int> bodies;
  std::vector<std::size_t> ties;  // the body's with them
  bool held = false;              // by what stands still
};

std::vector<Beside> besidesOf(const World& world, int body, const std::vector<Tie>& ties) {
  std::vector<Beside> out;
  for (std::size_t k = 0; k < ties.size(); ++k) {
    const int other = otherBody(*ties[k].contact, body);
    if (other < 0) continue;
    auto at = std::find_if(out.begin(), out.end(), [&](const Beside& b) {
      return std::find(b.bodies.begin(), b.bodies.end(), other) != b.bodies.end();
    });
    if (at == out.end()) {
      at = out.insert(at, Beside{{other}, {}, false});
      at->held = addTouched(world, body, at->bodies);
    }
    at->ties.push_back(k);
  }
  return out;
}

// Their side of C A^-1 C^T for the body's ties with them; what else holds them is tied.
// @param scale  as for lowerGram()
MatX yieldOf(World& world, int body, const std::vector<Tie>& ties, const Beside& beside, double scale) {
  std::vector<Tie> all;
  for (const std::size_t k : beside.ties) all.push_back(ties[k]);
  const Eigen::Index own = rowsOf(all);
  for (const Tie& t : tiesOf(world, beside.bodies)) {
    if (!involves(*t.contact, body)) all.push_back(t);
  }
  const MatX held = holding(lowerGram(world, beside.bodies, {}, all, scale), 0, all);
  return held.rows() == own ? held : tied(held, own);
}

// Of the rows that the step had of the body those that hold; none if any tie is not among them. Both are in the order
// of contacts.
std::vector<Eigen::Index> rowsInStep(const BodyContactRows& step, const std::vector<Contact>& contacts,
                                     const std::vector<Tie>& ties) {
  std::vector<Eigen::Index> out;
  auto tie = ties.begin();
  for (std::size_t k = 0; k < step.contacts.size() && tie != ties.end(); ++k) {
    if (!(contacts[step.contacts[k]] == *tie->contact)) continue;
    for (Eigen::Index row = 0; row < tie->rows(); ++row) out.push_back(static_cast<Eigen::Index>(3 * k) + row);
    ++tie;
  }
  if (tie != ties.end()) out.clear();
  return out;
}

// Of one body. What it rests on is tied: for those rows C, A^-1 becomes A^-1 - U S^-1 U^T, U = A^-1 C^T, S = C U. What
// other bodies give way there is added to S, so that they load it and do not hold it.
class Rested {
 public:
  Rested(World& world, int body, bool supported)
      : world_(world), body_(body), ties_(tiesOf(world, {body}, supported)), rows_(rowsOf(ties_)) {
    for (const Tie& t : ties_) holds_.push_back(nodesOf(*t.contact, body));
  }

  // S, and the forces of ties that go on: friction of what slides, all of what other bodies press with.
  void tie() {
    rub_ = VecX::Zero(unknowns(system().model()));
    for (std::size_t k = 0; k < ties_.size(); ++k) {
      const Vec3 &n = ties_[k].contact->normal, &force = ties_[k].force;
      if (otherBody(*ties_[k].contact, body_) >= 0) {
        addLoads(system(), holds_[k], force, rub_);
      } else if (ties_[k].slides) {
        addLoads(system(), holds_[k], Vec3(force - n.dot(force) * n), rub_);
      }
    }
    if (rows_ == 0) return;
    factor_ = heldGram();
    for (const Beside& beside : besidesOf(world_, body_, ties_)) addBeside(beside);
    shiftDiagonal(factor_);
    tied_ = choleskyInPlace(factor_);
  }
  // J A^-1 J^T and C A^-1 J^T; may run beside tie() and what follows it, up to meet().
  void touch(const std::vector<NodeSum>& sums) {
    sums_ = sums;
    const auto own = static_cast<Eigen::Index>(3 * sums.size());
    if (ties_.empty()) {
      gram_ = lowerGram(system(), sums).selfadjointView<Eigen::Lower>();
      half_.resize(0, own);
      return;
    }
    std::vector<NodeSum> all = sums;
    all.insert(all.end(), holds_.begin(), holds_.end());
    const MatX whole = between(system(), all, sums);
    gram_ = whole.topRows(own).selfadjointView<Eigen::Lower>();
    half_ = heldRows(own, [&](std::size_t k) { return whole.middleRows<3>(own + static_cast<Eigen::Index>(3 * k)); });
  }
  // The sums' rows with what holds the body.
  void meet() {
    if (!tied_) return;
    factor_.triangularView<Eigen::Lower>().solveInPlace(half_);
    gram_ -= half_.transpose() * half_;
  }

  const VecX& rub() const { return rub_; }
  BodySystem& system() const { return world_.body(body_).system; }
  const MatX& gram() const { return gram_; }  ///< J A^-1 J^T
  // A, where that is all: of a body without a frame that nothing holds.
  const SymmetricBlockMatrix* matrix() const {
    return ties_.empty() && !system().model().framed() ? &system().matrix() : nullptr;
  }

  // What the loads of these supports, all that hold the body, gain by forces on the sums: -S^-1 C A^-1 J^T.
  MatX bearing(const std::vector<PartnerSupport>& supports) const {
    MatX out = MatX::Zero(static_cast<Eigen::Index>(supports.size()), gram_.cols());
    if (!tied_) return out;
    MatX gained = half_;
    factor_.triangularView<Eigen::Lower>().transpose().solveInPlace(gained);
    for (std::size_t s = 0; s < supports.size(); ++s) {
      for (const int k : supports[s].contacts) out.row(static_cast<Eigen::Index>(s)) -= gained.row(k);
    }
    return out;
  }

  void solveAll(MatX& columns) const {
    solve(system(), columns);
    if (!tied_) return;
    MatX forces = movedTies(columns);  // C A^-1 loads, then S^-1 of that
    factor_.triangularView<Eigen::Lower>().solveInPlace(forces);
    factor_.triangularView<Eigen::Lower>().transpose().solveInPlace(forces);
    MatX held = MatX::Zero(columns.rows(), columns.cols());  // C^T forces
    Eigen::Index at = 0;
    for (std::size_t k = 0; k < ties_.size(); ++k) {
      addLoads(system(), holds_[k], MatX(ties_[k].axes() * forces.middleRows(at, ties_[k].rows())), held);
      at += ties_[k].rows();
    }
    solve(system(), held);
    columns -= held;
  }

  // The sums' motions by columns.
  MatX moved(const MatX& columns) const { return motionsOf(system(), sums_, columns); }

  MatX momentum(const MatX& columns) const {
    const BodyModel& model = system().model();
    MatX out = columns;
    for (int r = 0; r < model.freeNodes(); ++r) {
      out.middleRows<3>(3 * r) *= model.elasticity().mass()[model.free()[r]];
    }
    if (model.framed()) out.bottomRows<6>() = (frameMass() * out.bottomRows<6>()).eval();
    return out;
  }
  /// With what moves along.
  Mat6 frameMass() const { return system().handleMassAtStart() + moved_along_; }

 private:
  // S, lower triangle; what the step's Delassus operator has of it is taken.
  MatX heldGram() const {
    if (const BodyContactRows* step = world_.bodyRows(body_)) {
      const std::vector<Eigen::Index> in_step = rowsInStep(*step, world_.contacts().contacts, ties_);
      if (!in_step.empty()) return step->delassus(in_step, in_step);
    }
    return holding(lowerGram(system(), holds_), 0, ties_);
  }

  // What rests on a rigid body and nowhere else is mass that moves along: M gains it, and as the force that it presses
  // with has its share of the last step's acceleration, that is taken out. All else gives way as a spring would.
  void addBeside(const Beside& beside) {
    const bool along = system().model().isRigid() && !beside.held;
    const MatX yields = yieldOf(world_, body_, ties_, beside, along ? 0.0 : system().stiffnessScale());
    std::vector<Eigen::Index> at;  // of the rows in S
    for (const std::size_t k : beside.ties) {
      Eigen::Index first = 0;
      for (std::size_t i = 0; i < k; ++i) first += ties_[i].rows();
      for (Eigen::Index row = 0; row < ties_[k].rows(); ++row) at.push_back(first + row);
    }
    for (std::size_t i = 0; i < at.size(); ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        factor_(at[i], at[j]) += yields(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
      }
    }
    if (along) addMass(beside, yields, at);
  }

  void addMass(const Beside& beside, MatX yields, const std::vector<Eigen::Index>& at) {
    const MatX all = movedTies(MatX::Identity(6, 6));
    MatX ties(yields.rows(), 6);
    VecX gains(yields.rows());  // of their side's velocity in the last step [m/s^2]
    Eigen::Index row = 0;
    for (const std::size_t k : beside.ties) {
      const Contact& c = *ties_[k].contact;
      const int other = otherBody(c, body_);
      const BodySystem& theirs = world_.body(other).system;
      const VecX gain = (world_.body(other).state.velocities - theirs.startVelocities()) / theirs.input().step;
      const Vec3 a = c.first.body == other ? c.first.at(gain) : Vec3(-c.second.at(gain));
      gains.segment(row, ties_[k].rows()) = ties_[k].axes().transpose() * a;
      for (Eigen::Index i = 0; i < ties_[k].rows(); ++i, ++row) {
        ties.row(row) = all.row(at[static_cast<std::size_t>(row)]);
      }
    }
    shiftDiagonal(yields);
    if (!choleskyInPlace(yields)) return;
    yields.triangularView<Eigen::Lower>().solveInPlace(ties);
    yields.triangularView<Eigen::Lower>().solveInPlace(gains);
    const double s = system().model().elasticity().material().massScale(system().input().step);
    moved_along_ += ties.transpose() * ties / s;
    rub_ -= ties.transpose() * gains / s;
  }

  // C times columns.
  MatX movedTies(const MatX& columns) const {
    return heldRows(columns.cols(), [&](std::size_t k) { return applied(system(), holds_[k], columns); });
  }

  // Those rows of three for each tie that hold.
  template <class RowsOfTie>
  MatX heldRows(Eigen::Index columns, const RowsOfTie& three) const {
    MatX out(rows_, columns);
    Eigen::Index at = 0;
    for (std::size_t k = 0; k < ties_.size(); ++k) {
      out.middleRows(at, ties_[k].rows()) = ties_[k].axes().transpose() * three(k);
      at += ties_[k].rows();
    }
    return out;
  }

  World& world_;
  int body_;
  std::vector<NodeSum> sums_;
  std::vector<Tie> ties_;
  Eigen::Index rows_;                // of C
  std::vector<NodeSum> holds_;       // the body's side of the ties
  VecX rub_;                         // loads
  Mat6 moved_along_ = Mat6::Zero();  // mass of what rests on a rigid body alone
  MatX gram_, half_, factor_;        // J A^-1 J^T, C A^-1 J^T and then L^-1 of it, L of S
  bool tied_ = false;
};

constexpr double kFastest = 1e6;  // [1/s^2]: what is faster than a tick can show is left to W

// Of a body without free nodes: those motions that nothing holds.
Modes rigidModes(const Rested& rested, double s, double e) {
  const MatX mass = rested.momentum(MatX::Identity(6, 6));
  MatX root = mass;
  if (!choleskyInPlace(root)) return {MatX(6, 0), VecX(0)};
  root.triangularView<Eigen::StrictlyUpper>().setZero();
  MatX yields = root;
  rested.solveAll(yields);
  const SymmetricEigen found = symmetricEigen(MatX(root.transpose() * yields));
  Modes modes{MatX(6, 0), VecX(0)};
  for (Eigen::Index k = found.values.size() - 1; k >= 0; --k) {
    const double w2 = (1.0 / found.values[k] - s) / e;
    if (!(found.values[k] > 0) || w2 > kFastest) break;
    VecX shape = found.vectors.col(k);
    root.triangularView<Eigen::Lower>().transpose().solveInPlace(shape);
    modes.shapes.conservativeResize(6, modes.shapes.cols() + 1);
    modes.shapes.rightCols<1>() = shape;
    modes.squared_frequency.conservativeResize(modes.squared_frequency.size() + 1);
    modes.squared_frequency.tail<1>()[0] = std::max(w2, 0.0);
  }
  return modes;
}

Modes modesOf(const Rested& rested, const MatX* start, int count, double s, double e) {
  const BodyModel& model = rested.system().model();
  Modes modes;
  if (model.isRigid()) {
    modes = rigidModes(rested, s, e);
  } else {
    modes = findModes({unknowns(model), s, e, [&](MatX& columns) { rested.solveAll(columns); },
                       [&](const MatX& columns) { return rested.momentum(columns); }, rested.matrix()},
                      start != nullptr ? *start : MatX(), count);
  }
  Eigen::Index r = std::min<Eigen::Index>(count, modes.shapes.cols());
  while (r > 0 && !(modes.squared_frequency[r - 1] < kFastest)) --r;
  return {modes.shapes.leftCols(r), modes.squared_frequency.head(r)};
}

// Loads and velocities of what modes are of, at the corrected places.
struct PartnerMotion {
  VecX places, load, speed;
};

// Of all nodes.
VecX placesOf(const Body& body, const BodyCorrection* correction) {
  VecX x = body.state.positions;
  if (correction == nullptr) return x;
  for (int r = 0; r < body.model.freeNodes(); ++r) {
    x.segment<3>(3 * body.model.free()[r]) += correction->shift.segment<3>(3 * r);
  }
  return x;
}

PartnerMotion motionOf(World& world, int body, const BodyCorrection* correction) {
  const Body partner = world.body(body);
  const BodyModel& model = partner.model;
  PartnerMotion out;
  if (model.isRigid()) {
    out.load = VecX::Zero(6);
    out.load.head<3>() = model.handle().mass * world.gravity;
    out.speed = partner.state.handle.twist;
    if (correction != nullptr) out.speed += correction->velocity;
    return out;
  }
  const VecX x = placesOf(partner, correction);
  out.speed.resize(3 * model.freeNodes());
  for (int r = 0; r < model.freeNodes(); ++r) {
    out.speed.segment<3>(3 * r) = partner.state.velocities.segment<3>(3 * model.free()[r]);
  }
  if (correction != nullptr) out.speed += correction->velocity;
  const VecX& forces = partner.system.forcesAhead(x, partner.state);
  out.places.resize(3 * model.freeNodes());
  out.load.resize(3 * model.freeNodes());
  for (int r = 0; r < model.freeNodes(); ++r) {
    const int i = model.free()[r];
    out.places.segment<3>(3 * r) = x.segment<3>(3 * i);
    out.load.segment<3>(3 * r) = forces.segment<3>(3 * i) + model.elasticity().mass()[i] * world.gravity;
  }
  if (model.springStiffness().size() == 0) return out;
  const VecX anchors = model.anchors(world.state().time);
  for (int r = 0; r < model.freeNodes(); ++r) {
    const int i = model.free()[r];
    out.load.segment<3>(3 * r) -= model.springStiffness()[i] * (x - anchors).segment<3>(3 * i);
  }
  return out;
}

// A has h d + h^2 k of springs to the world where modes take it as e K, whose damping is the material's.
void addSprings(const BodyModel& model, const MatX& shapes, double h, double e, PartnerModes& out) {
  for (Eigen::Index k = 0; k < shapes.cols(); ++k) {
    double stiffness = 0, damping = 0;
    for (int r = 0; r < model.freeNodes(); ++r) {
      const int i = model.free()[r];
      const double square = shapes.col(k).segment<3>(3 * r).squaredNorm();
      stiffness += model.springStiffness()[i] * square;
      damping += model.springDamping()[i] * square;
    }
    const double taken = h * (damping + h * stiffness) / e;
    out.damping[k] += damping - model.elasticity().material().damping_beta * taken;
    out.squared_frequency[k] += stiffness - taken;
  }
}

// The body's modes, with what holds it.
Modes modesOf(const Rested& rested, const MatX* start, int count) {
  const BodySystem& system = rested.system();
  const BodyModel& model = system.model();
  if (count <= 0 || (model.framed() && !model.isRigid())) return {MatX(unknowns(model), 0), VecX(0)};
  return modesOf(rested, start, count, model.elasticity().material().massScale(system.input().step),
                 system.stiffnessScale());
}

// They are part of its answer to the sums; takes their part off W.
PartnerModes takeModes(World& world, int body, const Rested& rested, const Modes& modes, const PartnerInput& input,
                       MatX& w) {
  const BodySystem& system = rested.system();
  const BodyModel& model = system.model();
  PartnerModes out;
  const Material& material = model.elasticity().material();
  const double s = material.massScale(system.input().step), e = system.stiffnessScale();
  const Eigen::Index r = modes.shapes.cols();
  if (r == 0) return out;
  const PartnerMotion motion = motionOf(world, body, input.correction);
  out.squared_frequency = modes.squared_frequency;
  out.damping = (material.damping_alpha + material.damping_beta * modes.squared_frequency.array()).matrix();
  if (model.springStiffness().size() > 0) addSprings(model, modes.shapes, system.input().step, e, out);
  VecX load = motion.load + rested.rub();
  for (const auto& [sum, force] : input.loads) addLoads(system, sum, force, load);
  out.force = modes.shapes.transpose() * load;
  out.speed = modes.shapes.transpose() * rested.momentum(motion.speed);
  out.shape = rested.moved(modes.shapes);
  const VecX yields = (modes.squared_frequency.array() + s / e).inverse();
  w -= out.shape * yields.asDiagonal() * out.shape.transpose();
  out.basis = {{modes.shapes, motion.places}, body};
  if (model.isRigid()) {
    out.basis.pose = world.body(body).state.handle.pose;
    if (input.correction != nullptr) out.basis.pose = advance(out.basis.pose, input.correction->shift);
    out.basis.mass = rested.frameMass();
  }
  return out;
}

// One contact of a body with what it rests on.
struct Support {
  const ContactPoint* point;
  Vec3 place, normal, force;
  double load, friction;
  int contact;  // among those that hold the body
};

std::vector<Support> allSupports(const World& world, int body) {
  std::vector<Support> out;
  const VecX& x = world.body(body).state.positions;
  const std::vector<Tie> ties = tiesOf(world, {body}, true);
  for (std::size_t k = 0; k < ties.size(); ++k) {
    const Contact& c = *ties[k].contact;
    if (!ties[k].slides) return {};
    const bool first = c.first.body == body;
    const double sign = first ? 1.0 : -1.0;
    Support s{first ? &c.first : &c.second, {}, sign * c.normal, sign * ties[k].force, 0.0, c.friction,
              static_cast<int>(k)};
    s.place = s.point->at(x);
    s.load = s.normal.dot(s.force);
    if (s.load > 0) out.push_back(s);
  }
  return out;
}

}  // namespace

std::vector<PartnerSupport> supportsOf(const World& world, int body, int most) {
  if (!world.body(body).model.isRigid()) return {};
  if (gluedTo(world.state().contacts.loaded, body, world.toolIndex()).size() > 1) return {};
  const std::vector<Support> all = allSupports(world, body);
  if (all.empty()) return {};
  // the one with the most load first
  const auto heaviest =
      std::max_element(all.begin(), all.end(), [](const Support& a, const Support& b) { return a.load < b.load; });
  const Groups groups =
      farthestFirst(static_cast<int>(all.size()), static_cast<int>(heaviest - all.begin()), most, [&](int i, int j) {
        const Support &a = all[i], &b = all[j];
        return (a.place - b.place).norm() + (a.normal.dot(b.normal) > kAlike ? 0.0 : kOtherGroup);
      });
  if (groups.farthest >= kOtherGroup) return {};
  std::vector<PartnerSupport> out(static_cast<std::size_t>(groups.count));
  for (PartnerSupport& s : out) s.normal = s.force = Vec3::Zero();
  for (std::size_t i = 0; i < all.size(); ++i) out[groups.owner[i]].load += all[i].load;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Support& s = all[i];
    PartnerSupport& sum = out[groups.owner[i]];
    const double share = s.load / sum.load;
    for (int k = 0; k < s.point->count; ++k) sum.nodes.emplace_back(s.point->node[k], share * s.point->weight[k]);
    sum.normal += share * s.normal;
    sum.friction += share * s.friction;
    sum.force += s.force - s.load * s.normal;
    sum.contacts.push_back(s.contact);
  }
  for (PartnerSupport& s : out) s.normal.normalize();
  return out;
}

void forcesOfPartner(World& world, int body, const BodyCorrection* correction) {
  const Body partner = world.body(body);
  if (!partner.model.isRigid()) partner.system.forcesAhead(placesOf(partner, correction), partner.state);
}

struct PartnerReduction::Impl {
  World& world;
  int body;
  Rested rested;
  bool tied = false, touched = false;
  int count = -1;  // of modes that were asked for, -1: they are not known
  Modes modes{};

  void tie() {
    if (!tied) rested.tie();
    tied = true;
  }
};

PartnerReduction::PartnerReduction(World& world, int body, bool supported)
    : impl_(std::make_unique<Impl>(Impl{world, body, {world, body, supported}})) {}
PartnerReduction::~PartnerReduction() = default;
PartnerReduction::PartnerReduction(PartnerReduction&&) noexcept = default;
PartnerReduction& PartnerReduction::operator=(PartnerReduction&&) noexcept = default;

int PartnerReduction::body() const { return impl_->body; }

bool PartnerReduction::worthBeginning(const World& world, int body) {
  const BodyModel& model = world.body(body).model;
  return !model.framed() && model.freeNodes() > 0 &&
         gluedTo(world.state().contacts.loaded, body, world.toolIndex()).size() == 1;
}

void PartnerReduction::hold(const MatX* start, int modes) {
  impl_->tie();
  impl_->modes = modesOf(impl_->rested, start, modes);
  impl_->count = modes;
}

void PartnerReduction::touch(const std::vector<NodeSum>& sums) {
  impl_->rested.touch(sums);
  impl_->touched = true;
}

PartnerModes PartnerReduction::finish(const PartnerInput& input, MatX& own) {
  if (impl_->count != input.modes) hold(input.start, input.modes);
  if (!impl_->touched) touch(input.sums);
  Rested& rested = impl_->rested;
  rested.meet();
  own = rested.gram() * rested.system().stiffnessScale();
  PartnerModes modes = takeModes(impl_->world, impl_->body, rested, impl_->modes, input, own);
  if (input.supports != nullptr) modes.bearing = rested.bearing(*input.supports);
  return modes;
}

PartnerModes reducePartner(World& world, int body, const PartnerInput& input, MatX& out, PartnerReduction* begun) {
  // impulse to velocity becomes force to displacement: in a step dx = h dv, dlambda = h df, and c = h (h + beta)
  const std::vector<int> together = gluedTo(world.state().contacts.loaded, body, world.toolIndex());
  PartnerModes modes;
  MatX own;
  if (together.size() > 1) {
    std::vector<int> all = together;
    addTouched(world, -1, all);
    own = gluedCompliance(world, all, input.sums);
  } else if (begun != nullptr) {
    modes = begun->finish(input, own);
  } else {
    modes = PartnerReduction(world, body, input.supports != nullptr).finish(input, own);
  }
  for (std::size_t i = 0; i < input.sums.size(); ++i) {
    for (std::size_t j = 0; j < input.sums.size(); ++j) {
      out.block<3, 3>(input.sums[i].row, input.sums[j].row) +=
          own.block<3, 3>(static_cast<Eigen::Index>(3 * i), static_cast<Eigen::Index>(3 * j));
    }
  }
  return modes;
}

}  // namespace palpate
