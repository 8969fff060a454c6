#include "palpate/study/check.h"

#include <Eigen/LU>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "palpate/common/error.h"
#include "palpate/fem/polar.h"
#include "palpate/math/rotation.h"
#include "palpate/mesh/surface_measures.h"

namespace palpate {
namespace {

using Mat12 = Eigen::Matrix<double, 12, 12>;
using Vec12 = Eigen::Matrix<double, 12, 1>;
using Sparse = Eigen::SparseMatrix<double>;

// Textbook B^T D B of the linear tetrahedron, engineering strains xx, yy, zz, xy, yz, zx.
Mat12 referenceStiffness(const ElasticElement& e) {
  Eigen::Matrix<double, 6, 12> b = Eigen::Matrix<double, 6, 12>::Zero();
  for (int k = 0; k < 4; ++k) {
    const Vec3& g = e.gradient[k];
    b.block<6, 3>(0, 3 * k) << g.x(), 0, 0, 0, g.y(), 0, 0, 0, g.z(), g.y(), g.x(), 0, 0, g.z(), g.y(), g.z(), 0, g.x();
  }
  Eigen::Matrix<double, 6, 6> d = Eigen::Matrix<double, 6, 6>::Zero();
  d.topLeftCorner<3, 3>().setConstant(e.lambda);
  d.topLeftCorner<3, 3>().diagonal().array() += 2 * e.mu;
  d.bottomRightCorner<3, 3>().diagonal().setConstant(e.mu);
  const Eigen::Matrix<double, 6, 12> stress = d * b;
  return b.transpose() * stress;
}

// The same of a flat one with its principal directions held: sums over them, from the energy
//   sum_k w''_k (v_k^T g v_k - s_0)^2 / 2 + sum_kl t_kl (v_k^T (g + g^T) v_l)^2 / 4,   g = R^T F
// of which `push` is the derivative at g = 0.
void addFlat(const FlatElement& flat, const ElasticElement& e, const Mat3& rotation, double scale, Mat12& stiffness,
             Vec12& push) {
  const Mat3 v = rotation.transpose() * flat.frame;
  const auto add = [&](const Mat3& direction, double curvature, double offset) {
    Vec12 way;
    for (int k = 0; k < 4; ++k) way.segment<3>(3 * k) = direction * e.gradient[k];
    stiffness += scale * curvature * way * way.transpose();
    push -= scale * curvature * offset * way;
  };
  for (int k = 0; k < 3; ++k) {
    const Vec3 own = v.col(k), one = v.col((k + 1) % 3), other = v.col((k + 2) % 3);
    add(own * own.transpose(), flat.stretch[k], FlatElement::kStretch);
    add(one * other.transpose() + other * one.transpose(), flat.shear[k], 0.0);
  }
}

/// One body's step without contact, written the slow way. Unknowns: velocities of the free nodes, then the twist of its
/// frame if it has one.
class SlowBody {
 public:
  explicit SlowBody(const Body& body) : body_(body), rotation_(body.state.elastic.rotations) {
    const ElasticState& elastic = body.state.elastic;
    for (const ElasticElement& e : body.model.elasticity().elements()) {
      stiffness_.push_back(elastic.stiffness_scale * referenceStiffness(e));
    }
    for (const FlatElement& flat : elastic.flat) {
      const auto& node = body.model.elasticity().elements()[flat.element].node;
      Mat12 more = Mat12::Zero();
      Vec12 push = Vec12::Zero(), rest;
      addFlat(flat, body.model.elasticity().elements()[flat.element], rotation_[flat.element], elastic.stiffness_scale,
              more, push);
      for (int k = 0; k < 4; ++k) rest.segment<3>(3 * k) = body.model.mesh().mesh.nodes[node[k]];
      stiffness_[flat.element] += more;
      push_.emplace_back(flat.element, push + more * rest);  // as stiffness_ acts on displacements
    }
  }

  int unknowns() const { return frameColumn() + (body_.model.framed() ? 6 : 0); }
  Pose startPose() const { return body_.model.framed() ? body_.system.startPose() : Pose{}; }

  /// Positions at the start of the step for a frame that starts elsewhere.
  VecX positions(const Pose& pose) const {
    VecX x = body_.system.startPositions();
    if (!body_.model.framed()) return x;
    const Handle& frame = body_.model.handle();
    for (std::size_t k = 0; k < frame.nodes.size(); ++k)
      x.segment<3>(3 * frame.nodes[k]) = pose.apply(frame.offsets[k]);
    return x;
  }

  void turnElements(const VecX& x) {
    for (std::size_t e = 0; e < rotation_.size(); ++e) {
      const ElasticElement& element = body_.model.elasticity().elements()[e];
      rotation_[e] = polarRotation(element.deformationGradient(x), body_.state.elastic.rotations[e]);
    }
  }

  VecX elasticForces(const VecX& x) const {
    VecX f = VecX::Zero(x.size());
    for (std::size_t e = 0; e < stiffness_.size(); ++e) {
      const auto& node = body_.model.elasticity().elements()[e].node;
      Vec12 d;
      for (int k = 0; k < 4; ++k) {
        d.segment<3>(3 * k) =
            rotation_[e].transpose() * x.segment<3>(3 * node[k]) - body_.model.mesh().mesh.nodes[node[k]];
      }
      const Vec12 local = stiffness_[e] * d;
      for (int k = 0; k < 4; ++k) f.segment<3>(3 * node[k]) -= rotation_[e] * local.segment<3>(3 * k);
    }
    for (const auto& [e, push] : push_) {
      const auto& node = body_.model.elasticity().elements()[e].node;
      for (int k = 0; k < 4; ++k) f.segment<3>(3 * node[k]) -= rotation_[e] * push.segment<3>(3 * k);
    }
    return f;
  }

  void buildSystem(const Pose& pose) {
    const double h = body_.system.input().step;
    const Material& material = body_.model.elasticity().material();
    std::vector<Eigen::Triplet<double>> entries;
    Mat6 frame = Mat6::Zero();
    for (std::size_t e = 0; e < stiffness_.size(); ++e) addElement(e, pose, entries, frame);
    for (int i = 0; i < body_.model.nodes(); ++i) {
      if (body_.model.row()[i] < 0) continue;
      double diagonal = (1 + h * material.damping_alpha) * body_.model.elasticity().mass()[i];
      if (body_.model.springStiffness().size() > 0) {
        diagonal += h * body_.model.springDamping()[i] + h * h * body_.model.springStiffness()[i];
      }
      addBlock(entries, 3 * body_.model.row()[i], 3 * body_.model.row()[i], Mat3(diagonal * Mat3::Identity()));
    }
    if (body_.model.framed()) {
      addFrame(pose, frame);
      addBlock(entries, frameColumn(), frameColumn(), MatX(frame));
    }
    Sparse a(unknowns(), unknowns());
    a.setFromTriplets(entries.begin(), entries.end());
    solver_.compute(a);
    if (solver_.info() != Eigen::Success) throw RunError("check: the step's matrix is not positive definite");
    system_pose_ = pose;
  }

  MatX solve(const MatX& right) const { return solver_.solve(right); }

  VecX rightHandSide(const Pose& pose, const Vec6& twist, const VecX& f) const {
    const StepInput& in = body_.system.input();
    const double h = in.step;
    VecX b(unknowns());
    const VecX anchors = body_.model.anchors(in.end_time), loads = drivenLoads();
    Vec6 wrench = Vec6::Zero();
    for (int i = 0; i < body_.model.nodes(); ++i) {
      const double m = body_.model.elasticity().mass()[i];
      if (body_.model.row()[i] >= 0) {
        b.segment<3>(3 * body_.model.row()[i]) =
            m * body_.system.startVelocities().segment<3>(3 * i) + h * (f.segment<3>(3 * i) + m * in.gravity);
        if (body_.model.springStiffness().size() > 0) {
          b.segment<3>(3 * body_.model.row()[i]) -=
              h * body_.model.springStiffness()[i] *
              (body_.system.startPositions().segment<3>(3 * i) - anchors.segment<3>(3 * i));
        }
        b.segment<3>(3 * body_.model.row()[i]) -= h * loads.segment<3>(3 * i);
      } else if (!body_.model.isFixed(i)) {  // with the weight's lever arms, node by node
        const Vec3 force = f.segment<3>(3 * i) + m * in.gravity - loads.segment<3>(3 * i);
        wrench.head<3>() += force;
        wrench.tail<3>() += (pose.rotation * body_.model.handle().offsets[body_.model.attachedIndex()[i]]).cross(force);
      }
    }
    if (!body_.model.framed()) return b;
    const Handle& frame = body_.model.handle();
    wrench.head<3>() += (frame.mass - frame.attached_mass) * in.gravity;
    if (body_.model.held()) {
      wrench -= linkWrenchOnDevice(in.link, pose, Vec6::Zero(), in.device.pose, in.device.twist);
    }
    const Mat3 live = pose.matrix() * frame.inertia * pose.matrix().transpose();
    const Vec3 w = twist.tail<3>();
    wrench.tail<3>() -= w.cross(live * w);
    Vec6 momentum;
    momentum.head<3>() = frame.mass * twist.head<3>();
    momentum.tail<3>() = inertia_ * twist.tail<3>();  // that of A
    b.tail<6>() = momentum + h * wrench;
    return b;
  }

  /// Rows of all contacts, in this body's unknowns.
  MatX contactRows(const ContactSet& set, int self, const Pose& pose) const {
    MatX j = MatX::Zero(static_cast<Eigen::Index>(3 * set.contacts.size()), unknowns());
    for (std::size_t i = 0; i < set.contacts.size(); ++i) {
      const Contact& c = set.contacts[i];
      for (const auto& [point, sign] : {std::pair(&c.first, 1.0), std::pair(&c.second, -1.0)}) {
        if (point->body != self) continue;
        for (int k = 0; k < point->count; ++k) {
          const int row = body_.model.row()[point->node[k]];
          if (body_.model.isFixed(point->node[k])) continue;
          const MatX block = row >= 0 ? MatX(Mat3::Identity()) : MatX(jacobian(point->node[k], pose));
          j.block(static_cast<Eigen::Index>(3 * i), row >= 0 ? 3 * row : frameColumn(), 3, block.cols()) +=
              sign * point->weight[k] * c.frame() * block;
        }
      }
    }
    return j;
  }

  /// Velocity of all contacts' rows by nodes that the world drives.
  VecX drivenRows(const ContactSet& set, int self) const {
    VecX out = VecX::Zero(static_cast<Eigen::Index>(3 * set.contacts.size()));
    for (std::size_t i = 0; i < set.contacts.size(); ++i) {
      const Contact& c = set.contacts[i];
      for (const auto& [point, sign] : {std::pair(&c.first, 1.0), std::pair(&c.second, -1.0)}) {
        if (point->body != self) continue;
        for (int k = 0; k < point->count; ++k) {
          if (!body_.model.isFixed(point->node[k])) continue;
          out.segment<3>(static_cast<Eigen::Index>(3 * i)) +=
              sign * point->weight[k] * c.frame() * body_.system.fixedVelocity(point->node[k]);
        }
      }
    }
    return out;
  }

  /// Coupling wrench of the handle.
  Vec6 wrench(const Pose& pose, const VecX& f, const VecX& v) const {
    const double time = body_.system.input().step + body_.model.elasticity().material().damping_beta;
    VecX end = f;
    const Vec6 u = v.tail<6>();
    for (std::size_t e = 0; e < stiffness_.size(); ++e) {
      const auto& node = body_.model.elasticity().elements()[e].node;
      Vec12 velocity;
      for (int k = 0; k < 4; ++k) {
        const int row = body_.model.row()[node[k]];
        velocity.segment<3>(3 * k) = body_.system.fixedVelocity(node[k]);
        if (row >= 0) {
          velocity.segment<3>(3 * k) = v.segment<3>(3 * row);
        } else if (!body_.model.isFixed(node[k])) {
          velocity.segment<3>(3 * k) = jacobian(node[k], system_pose_) * u;
        }
      }
      const Vec12 force = -time * (rotatedStiffness(e) * velocity);
      for (int k = 0; k < 4; ++k) end.segment<3>(3 * node[k]) += force.segment<3>(3 * k);
    }
    Vec6 out = Vec6::Zero();
    const Handle& handle = body_.model.handle();
    for (std::size_t k = 0; k < handle.nodes.size(); ++k) {
      const Vec3 force = end.segment<3>(3 * handle.nodes[k]);
      out.head<3>() += force;
      out.tail<3>() += (pose.rotation * handle.offsets[k]).cross(force);
    }
    return out;
  }

 private:
  int frameColumn() const { return 3 * body_.model.freeNodes(); }

  // G of node n for a rotation of the frame: dv = [I, -[R r]x] u
  Eigen::Matrix<double, 3, 6> jacobian(int n, const Pose& pose) const {
    Eigen::Matrix<double, 3, 6> g;
    g.leftCols<3>().setIdentity();
    g.rightCols<3>() = -skew(pose.rotation * body_.model.handle().offsets[body_.model.attachedIndex()[n]]);
    return g;
  }

  Mat12 rotatedStiffness(std::size_t e) const {
    Mat12 rotated;
    for (int i = 0; i < 12; i += 3) {
      for (int j = 0; j < 12; j += 3) {
        const Mat3 turned = rotation_[e] * stiffness_[e].block<3, 3>(i, j);
        rotated.block<3, 3>(i, j) = turned * rotation_[e].transpose();
      }
    }
    return rotated;
  }

  // (h + beta) K v of the nodes that the world drives [N].
  VecX drivenLoads() const {
    VecX loads = VecX::Zero(3 * body_.model.nodes());
    for (const int e : body_.model.fixedElements()) {
      const auto& node = body_.model.elasticity().elements()[e].node;
      Vec12 velocity = Vec12::Zero();
      for (int k = 0; k < 4; ++k) {
        if (body_.model.isFixed(node[k])) velocity.segment<3>(3 * k) = body_.system.fixedVelocity(node[k]);
      }
      const Vec12 force = body_.system.stiffnessScale() / body_.system.input().step *
                          (rotatedStiffness(static_cast<std::size_t>(e)) * velocity);
      for (int k = 0; k < 4; ++k) loads.segment<3>(3 * node[k]) += force.segment<3>(3 * k);
    }
    return loads;
  }

  void addElement(std::size_t e, const Pose& pose, std::vector<Eigen::Triplet<double>>& entries, Mat6& frame) const {
    const auto& node = body_.model.elasticity().elements()[e].node;
    const Mat12 k = body_.system.stiffnessScale() * rotatedStiffness(e);
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) {
        const int ri = body_.model.row()[node[i]];
        const int rj = body_.model.row()[node[j]];
        if (body_.model.isFixed(node[i]) || body_.model.isFixed(node[j])) continue;
        const Mat3 block = k.block<3, 3>(3 * i, 3 * j);
        if (ri >= 0 && rj >= 0) {
          addBlock(entries, 3 * ri, 3 * rj, block);
        } else if (ri >= 0) {
          const Eigen::Matrix<double, 3, 6> g = block * jacobian(node[j], pose);
          addBlock(entries, 3 * ri, frameColumn(), g);
          addBlock(entries, frameColumn(), 3 * ri, MatX(g.transpose()));
        } else if (rj < 0) {
          frame += jacobian(node[i], pose).transpose() * block * jacobian(node[j], pose);
        }
      }
    }
  }

  void addFrame(const Pose& pose, Mat6& frame) {
    const Handle& handle = body_.model.handle();
    const double h = body_.system.input().step;
    const double drag = h * body_.model.elasticity().material().damping_alpha;
    const Mat3 r = pose.matrix();
    frame.topLeftCorner<3, 3>() += (handle.mass + drag * handle.attached_mass) * Mat3::Identity();
    frame.bottomRightCorner<3, 3>() += r * (handle.inertia + drag * handle.attached_inertia) * r.transpose();
    if (body_.model.held()) {
      const LinkParameters& link = body_.system.input().link;
      const Mat3 jl =
          leftJacobianInverse(logRotation(pose.rotation * body_.system.input().device.pose.rotation.conjugate()));
      frame.topLeftCorner<3, 3>() += (h * link.damping + h * h * link.stiffness) * Mat3::Identity();
      frame.bottomRightCorner<3, 3>() += h * link.rotational_damping * Mat3::Identity() +
                                         0.5 * h * h * link.rotational_stiffness * (jl + jl.transpose());
    }
    inertia_ = r * handle.inertia * r.transpose();
  }

  template <typename Block>
  static void addBlock(std::vector<Eigen::Triplet<double>>& entries, int row, int column, const Block& block) {
    for (int i = 0; i < block.rows(); ++i) {
      for (int j = 0; j < block.cols(); ++j) entries.emplace_back(row + i, column + j, block(i, j));
    }
  }

  const Body body_;
  std::vector<Mat12> stiffness_;
  std::vector<std::pair<int, Vec12>>
      push_;  // of flat elements, forces in the rest frame where the shape is that of rest
  std::vector<Mat3> rotation_;
  Eigen::SimplicialLDLT<Sparse> solver_;
  Mat3 inertia_ = Mat3::Zero();
  Pose system_pose_;
};

/// The step of tool and all bodies that moved with it, the slow way.
class SlowStep {
 public:
  SlowStep(const World& world, bool frozen)
      : world_(world), tool_(world.tool()), set_(carrying(world.contacts())), frozen_(frozen), slow_tool_(tool_) {
    slow_tool_.buildSystem(tool_.system.startPose());
    const auto rows = static_cast<Eigen::Index>(3 * set_.contacts.size());
    other_delassus_.setZero(rows, rows);
    other_free_.setZero(rows);
    for (const int index : set_.bodies) {
      if (index == world.toolIndex() || rows == 0) continue;
      const Body body = world.body(index);
      SlowBody other(body);
      const Pose pose = other.startPose();
      other.buildSystem(pose);
      const VecX f = other.elasticForces(other.positions(pose));
      const Vec6 twist = body.model.framed() ? body.system.startTwist() : Vec6::Zero();
      const MatX j = other.contactRows(set_, index, pose);
      other_delassus_ += j * other.solve(j.transpose());
      other_free_ += j * other.solve(other.rightHandSide(pose, twist, f)) + other.drivenRows(set_, index);
    }
  }

  /// Fc for a handle that starts elsewhere.
  Vec6 force(const Pose& pose, const Vec6& twist) {
    const VecX x = slow_tool_.positions(pose);
    if (!frozen_) {
      slow_tool_.turnElements(x);
      slow_tool_.buildSystem(pose);
    }
    const VecX f = slow_tool_.elasticForces(x);
    VecX v = slow_tool_.solve(slow_tool_.rightHandSide(pose, twist, f));
    Vec6 contact = Vec6::Zero();
    if (!set_.contacts.empty()) {
      const MatX j = slow_tool_.contactRows(set_, world_.toolIndex(), frozen_ ? tool_.system.startPose() : pose);
      const MatX response = slow_tool_.solve(j.transpose());
      const VecX lambda = solveStates(j * response + other_delassus_,
                                      j * v + slow_tool_.drivenRows(set_, world_.toolIndex()) + other_free_, gaps(x));
      v += response * lambda;
      contact = j.rightCols<6>().transpose() * lambda / tool_.system.input().step;
    }
    return slow_tool_.wrench(pose, f, v) + contact;
  }

 private:
  // The contacts that carry force; the others' impulses stay zero.
  static ContactSet carrying(const ContactSet& all) {
    ContactSet out;
    out.bodies = all.bodies;
    out.glued = all.glued;
    out.impulse.resize(static_cast<Eigen::Index>(3 * (all.glued + all.active())));
    for (std::size_t i = 0; i < all.contacts.size(); ++i) {
      if (all.status[i].state == ContactState::open) continue;
      out.impulse.segment<3>(static_cast<Eigen::Index>(3 * out.contacts.size())) =
          all.impulse.segment<3>(static_cast<Eigen::Index>(3 * i));
      out.contacts.push_back(all.contacts[i]);
      out.status.push_back(all.status[i]);
    }
    return out;
  }

  // Along the normal and both tangents of each, which count of what is glued alone.
  VecX gaps(const VecX& x) const {
    VecX g(static_cast<Eigen::Index>(3 * set_.contacts.size()));
    for (std::size_t i = 0; i < set_.contacts.size(); ++i) {
      const Contact& c = set_.contacts[i];
      auto gap = g.segment<3>(static_cast<Eigen::Index>(3 * i));
      gap << c.gap, c.tangent_gap[0], c.tangent_gap[1];
      for (const auto& [point, sign] : {std::pair(&c.first, 1.0), std::pair(&c.second, -1.0)}) {
        if (point->body != world_.toolIndex()) continue;
        for (int k = 0; k < point->count; ++k) {
          const Vec3 moved =
              x.segment<3>(3 * point->node[k]) - tool_.system.startPositions().segment<3>(3 * point->node[k]);
          gap += c.follows * sign * point->weight[k] * (c.frame() * moved);
        }
      }
    }
    return g;
  }

  // Newton on the equalities that the contacts' states say; linear but for sliding on the exact cone.
  VecX solveStates(const MatX& w, const VecX& free, const VecX& gap) {
    const double h = tool_.system.input().step;
    const int facets = world_.contact.cone.facets;
    VecX lambda = set_.impulse;
    const Eigen::Index rows = lambda.size();
    const bool turning = set_.count(ContactState::slide) > 0;
    double previous = std::numeric_limits<double>::infinity();
    for (int iteration = 0; iteration < 30; ++iteration) {
      const VecX velocity = w * lambda + free;
      VecX r(rows);
      MatX by_velocity = MatX::Zero(rows, rows);
      MatX by_lambda = MatX::Zero(rows, rows);
      for (Eigen::Index i = 0; i < rows; i += 3) {
        const ContactStatus s = set_.status[static_cast<std::size_t>(i / 3)];
        const double mu = set_.contacts[static_cast<std::size_t>(i / 3)].friction;
        const Eigen::Vector2d vt = velocity.segment<2>(i + 1);
        const Eigen::Vector2d lt = lambda.segment<2>(i + 1);
        r[i] = velocity[i] + gap[i] / h;
        by_velocity(i, i) = 1;
        if (s.state == ContactState::stick) {
          r.segment<2>(i + 1) = vt;
          if (set_.contacts[static_cast<std::size_t>(i / 3)].glued()) r.segment<2>(i + 1) += gap.segment<2>(i + 1) / h;
          by_velocity.block<2, 2>(i + 1, i + 1).setIdentity();
        } else if (s.state == ContactState::vertex) {
          const Eigen::Vector2d d = vertexDirection(s.index, facets).tail<2>();
          r.segment<2>(i + 1) = lt - mu * lambda[i] * d;
          by_lambda.block<2, 2>(i + 1, i + 1).setIdentity();
          by_lambda.block<2, 1>(i + 1, i) = -mu * d;
        } else if (s.state == ContactState::edge) {
          const Eigen::Vector2d along = edgeTangent(s.index, facets).tail<2>();
          const Eigen::Vector2d out = edgeNormal(s.index, facets).tail<2>();
          r[i + 1] = along.dot(vt);
          by_velocity.block<1, 2>(i + 1, i + 1) = along.transpose();
          r[i + 2] = out.dot(lt) - mu * std::cos(M_PI / facets) * lambda[i];
          by_lambda.block<1, 2>(i + 2, i + 1) = out.transpose();
          by_lambda(i + 2, i) = -mu * std::cos(M_PI / facets);
        } else {
          const double speed = mu > 0 ? vt.norm() : 1.0;
          const Eigen::Vector2d t = mu > 0 ? Eigen::Vector2d(vt / speed) : Eigen::Vector2d::Zero();
          r.segment<2>(i + 1) = lt + mu * lambda[i] * t;
          by_lambda.block<2, 2>(i + 1, i + 1).setIdentity();
          by_lambda.block<2, 1>(i + 1, i) = mu * t;
          by_velocity.block<2, 2>(i + 1, i + 1) =
              mu * lambda[i] / speed * (Eigen::Matrix2d::Identity() - t * t.transpose());
        }
      }
      if (!frozen_ || turning || !decomposed_) {  // else all is linear, and the matrix ever the same
        decomposition_.setThreshold(1e-11);
        decomposition_.compute(by_velocity * w + by_lambda);
        decomposed_ = true;
      }
      const VecX step = decomposition_.solve(r);
      lambda -= step;
      const double size = step.norm() / lambda.norm();
      if (size <= 1e-14 || (size < 1e-8 && size > 0.3 * previous)) break;  // as small as rounding lets it be
      previous = size;
    }
    return lambda;
  }

  const World& world_;
  const Body tool_;
  ContactSet set_;  // those that carry force
  bool frozen_;
  SlowBody slow_tool_;
  Eigen::FullPivLU<MatX> decomposition_;  // contacts may be redundant
  bool decomposed_ = false;
  MatX other_delassus_;  // of the bodies that the handle's motion does not reach but through contact
  VecX other_free_;
};

// Slowest slip of what slides on the exact cone [m/s]; infinite: nothing does. Friction turns with the slip, so what
// changes it by more than a part of itself is no small change.
double slowestSlip(const ContactSet& set) {
  double slowest = std::numeric_limits<double>::infinity();
  if (set.contacts.empty()) return slowest;
  const VecX velocity = set.rowVelocity();
  for (std::size_t i = 0; i < set.contacts.size(); ++i) {
    if (set.status[i].state != ContactState::slide || !(set.contacts[i].friction > 0)) continue;
    slowest = std::min(slowest, velocity.segment<2>(static_cast<Eigen::Index>(3 * i + 1)).norm());
  }
  return slowest;
}

// Of fourth order: (8 (f(d) - f(-d)) - (f(2d) - f(-2d))) / 12 d.
template <class Force>
Vec6 centralDifference(const Force& force, double d) {
  return (8 * (force(d) - force(-d)) - (force(2 * d) - force(-2 * d))) / (12 * d);
}

void centralDifferences(SlowStep& step, const World& world, double length, Mat6& kx, Mat6& kv) {
  const Body tool = world.tool();
  const double speed = std::min(1e-3, std::max(1e-2 * slowestSlip(world.contacts()), 1e-7));
  const double angle = std::min(1e-5, speed * tool.system.input().step / length);
  for (int k = 0; k < 6; ++k) {
    const Vec6 along = Vec6::Unit(k) * (k < 3 ? 1.0 : 1.0 / length);
    kx.col(k) = centralDifference(
        [&](double d) { return step.force(advance(tool.system.startPose(), d * along), tool.system.startTwist()); },
        angle * length);
    kv.col(k) = centralDifference(
        [&](double d) { return step.force(tool.system.startPose(), tool.system.startTwist() + d * along); }, speed);
    if (k < 3) continue;
    kx.col(k) *= length;
    kv.col(k) *= length;
  }
}

double halfDiagonal(const Body& tool) { return 0.5 * boundsOf(tool.model.mesh().surface.vertices).diagonal(); }

}  // namespace

double BlockErrors::worst() const { return *std::max_element(block.begin(), block.end()); }

BlockErrors compareBlocks(const Mat6& model, const Mat6& reference, double length, double nothing) {
  Mat6 scaled_reference = reference;
  Mat6 difference = model - reference;
  for (Mat6* m : {&scaled_reference, &difference}) {
    m->rightCols<3>() /= length;
    m->bottomRows<3>() /= length;
  }
  BlockErrors errors;
  const double floor = std::max(1e-6 * scaled_reference.norm(), nothing);
  for (int i = 0; i < 2; ++i) {
    for (int j = 0; j < 2; ++j) {
      errors.block[2 * i + j] = difference.block<3, 3>(3 * i, 3 * j).norm() /
                                std::max({scaled_reference.block<3, 3>(3 * i, 3 * j).norm(), floor, 1e-300});
    }
  }
  return errors;
}

LinearizationCheck checkLinearization(World& world, const DeviceTarget& device, double h,
                                      const LinearizationSettings& settings) {
  if (world.evaluate(device, h).status == StepStatus::restored) throw RunError("check: the step failed");
  const Body tool = world.tool();
  const ContactSet& set = world.contacts();
  const HandleModel model = linearize(world, settings, 0.0);
  const double length = halfDiagonal(tool);
  LinearizationCheck out;
  out.active = set.active();
  out.sticking = set.count(ContactState::stick);
  out.sliding = out.active - out.sticking;
  // a rigid tool that touches nothing has no derivatives but rounding: against what its mass resists in a step
  const double by_twist = 1e-6 * tool.model.handle().mass / h, by_pose = by_twist / h;
  Mat6 kx, kv;
  SlowStep frozen(world, true);
  centralDifferences(frozen, world, length, kx, kv);
  out.kx_frozen = compareBlocks(model.kx, kx, length, by_pose);
  out.kv_frozen = compareBlocks(model.kv, kv, length, by_twist);
  const Vec6 force = frozen.force(tool.system.startPose(), tool.system.startTwist());
  out.force_error = (force - model.force).norm() / std::max(force.norm(), 1e-12);
  SlowStep full(world, false);
  centralDifferences(full, world, length, kx, kv);
  out.kx_full = compareBlocks(model.kx, kx, length, by_pose);
  out.kv_full = compareBlocks(model.kv, kv, length, by_twist);
  return out;
}

}  // namespace palpate
