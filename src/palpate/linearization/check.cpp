#include "palpate/linearization/check.h"

#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <vector>

#include "palpate/common/error.h"
#include "palpate/fem/polar.h"
#include "palpate/math/rotation.h"

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
  return b.transpose() * d * b;
}

/// The step written the slow way. Unknowns: velocities of the free nodes, then the handle's twist.
class SlowStep {
 public:
  SlowStep(const World& world, bool frozen)
      : world_(world), tool_(world.tool()), set_(world.toolContacts()), frozen_(frozen) {
    for (const ElasticElement& e : tool_.elasticity().elements()) {
      stiffness_.push_back(referenceStiffness(e));
      rotation_.push_back(e.rotation);
    }
    if (frozen_) buildSystem(tool_.startPose());
  }

  /// Fc for a handle that starts elsewhere.
  Vec6 force(const Pose& pose, const Vec6& twist) {
    const Body& t = tool_;
    const Handle& handle = t.handle();
    VecX x = t.startPositions();
    for (std::size_t k = 0; k < handle.nodes.size(); ++k)
      x.segment<3>(3 * handle.nodes[k]) = pose.apply(handle.offsets[k]);
    if (!frozen_) {
      for (std::size_t e = 0; e < rotation_.size(); ++e) {
        const ElasticElement& element = t.elasticity().elements()[e];
        rotation_[e] = polarRotation(element.deformationGradient(x), element.rotation);
      }
      buildSystem(pose);
    }
    const VecX f = elasticForces(x);
    const VecX b = rightHandSide(pose, twist, f);
    const MatX j = contactRows(frozen_ ? t.startPose() : pose);
    const VecX gap = gaps(x);
    VecX v = solver_.solve(b);
    VecX lambda = VecX::Zero(j.rows());
    if (j.rows() > 0) {
      const MatX response = solver_.solve(MatX(j.transpose()));
      lambda = solveStates(j * response, j * v, gap);
      v += response * lambda;
    }
    return wrench(pose, f, v, lambda, j);
  }

 private:
  int handleColumn() const { return 3 * tool_.freeNodes(); }

  // G of node n for a handle rotation: dv = [I, -[R r]x] u
  Eigen::Matrix<double, 3, 6> jacobian(int n, const Pose& pose) const {
    Eigen::Matrix<double, 3, 6> g;
    g.leftCols<3>().setIdentity();
    g.rightCols<3>() = -skew(pose.rotation * tool_.handle().offsets[tool_.attachedIndex()[n]]);
    return g;
  }

  Mat12 rotatedStiffness(std::size_t e) const {
    Mat12 r = Mat12::Zero();
    for (int k = 0; k < 4; ++k) r.block<3, 3>(3 * k, 3 * k) = rotation_[e];
    return r * stiffness_[e] * r.transpose();
  }

  VecX elasticForces(const VecX& x) const {
    VecX f = VecX::Zero(x.size());
    for (std::size_t e = 0; e < stiffness_.size(); ++e) {
      const auto& node = tool_.elasticity().elements()[e].node;
      Vec12 d;
      for (int k = 0; k < 4; ++k) {
        d.segment<3>(3 * k) = rotation_[e].transpose() * x.segment<3>(3 * node[k]) - tool_.mesh().mesh.nodes[node[k]];
      }
      const Vec12 local = stiffness_[e] * d;
      for (int k = 0; k < 4; ++k) f.segment<3>(3 * node[k]) -= rotation_[e] * local.segment<3>(3 * k);
    }
    return f;
  }

  void buildSystem(const Pose& pose) {
    const Body& t = tool_;
    const double h = t.input().step;
    const Material& material = t.elasticity().material();
    const int n = handleColumn() + 6;
    std::vector<Eigen::Triplet<double>> entries;
    Eigen::Matrix<double, 6, 6> hh = Eigen::Matrix<double, 6, 6>::Zero();
    for (std::size_t e = 0; e < stiffness_.size(); ++e) {
      const auto& node = t.elasticity().elements()[e].node;
      const Mat12 k = t.stiffnessScale() * rotatedStiffness(e);
      for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 4; ++j) {
          const int ri = t.row()[node[i]];
          const int rj = t.row()[node[j]];
          const Mat3 block = k.block<3, 3>(3 * i, 3 * j);
          if (ri >= 0 && rj >= 0) {
            addBlock(entries, 3 * ri, 3 * rj, block);
          } else if (ri >= 0) {
            const Eigen::Matrix<double, 3, 6> g = block * jacobian(node[j], pose);
            addBlock(entries, 3 * ri, handleColumn(), g);
            addBlock(entries, handleColumn(), 3 * ri, MatX(g.transpose()));
          } else if (rj < 0) {
            hh += jacobian(node[i], pose).transpose() * block * jacobian(node[j], pose);
          }
        }
      }
    }
    for (int i = 0; i < t.nodes(); ++i) {
      if (t.row()[i] < 0) continue;
      addBlock(entries, 3 * t.row()[i], 3 * t.row()[i],
               Mat3((1 + h * material.damping_alpha) * t.elasticity().mass()[i] * Mat3::Identity()));
    }
    const Mat3 r = pose.matrix();
    const LinkParameters& link = t.input().link;
    hh.topLeftCorner<3, 3>() += (t.handle().mass + h * material.damping_alpha * t.handle().attached_mass +
                                 h * link.damping + h * h * link.stiffness) *
                                Mat3::Identity();
    const Mat3 jl = leftJacobianInverse(logRotation(pose.rotation * t.input().device.pose.rotation.conjugate()));
    hh.bottomRightCorner<3, 3>() +=
        r * (t.handle().inertia + h * material.damping_alpha * t.handle().attached_inertia) * r.transpose() +
        h * link.rotational_damping * Mat3::Identity() +
        0.5 * h * h * link.rotational_stiffness * (jl + jl.transpose());
    addBlock(entries, handleColumn(), handleColumn(), MatX(hh));
    Sparse a(n, n);
    a.setFromTriplets(entries.begin(), entries.end());
    solver_.compute(a);
    if (solver_.info() != Eigen::Success) throw RunError("check: the step's matrix is not positive definite");
    inertia_ = r * t.handle().inertia * r.transpose();
    system_pose_ = pose;
  }

  template <typename Block>
  static void addBlock(std::vector<Eigen::Triplet<double>>& entries, int row, int column, const Block& block) {
    for (int i = 0; i < block.rows(); ++i) {
      for (int j = 0; j < block.cols(); ++j) entries.emplace_back(row + i, column + j, block(i, j));
    }
  }

  VecX rightHandSide(const Pose& pose, const Vec6& twist, const VecX& f) const {
    const Body& t = tool_;
    const StepInput& in = t.input();
    const double h = in.step;
    VecX b(handleColumn() + 6);
    Vec6 wrench = Vec6::Zero();
    for (int i = 0; i < t.nodes(); ++i) {
      const double m = t.elasticity().mass()[i];
      if (t.row()[i] >= 0) {
        b.segment<3>(3 * t.row()[i]) =
            m * t.startVelocities().segment<3>(3 * i) + h * (f.segment<3>(3 * i) + m * in.gravity);
      } else {  // with the weight's lever arms, node by node
        const Vec3 force = f.segment<3>(3 * i) + m * in.gravity;
        wrench.head<3>() += force;
        wrench.tail<3>() += (pose.rotation * t.handle().offsets[t.attachedIndex()[i]]).cross(force);
      }
    }
    wrench.head<3>() += (t.handle().mass - t.handle().attached_mass) * in.gravity;
    wrench -= linkWrenchOnDevice(in.link, pose, Vec6::Zero(), in.device.pose, in.device.twist);
    const Mat3 live = pose.matrix() * t.handle().inertia * pose.matrix().transpose();
    const Vec3 w = twist.tail<3>();
    wrench.tail<3>() -= w.cross(live * w);
    Vec6 momentum;
    momentum.head<3>() = t.handle().mass * twist.head<3>();
    momentum.tail<3>() = inertia_ * twist.tail<3>();  // that of A
    b.tail<6>() = momentum + h * wrench;
    return b;
  }

  MatX contactRows(const Pose& pose) const {
    MatX j = MatX::Zero(static_cast<Eigen::Index>(3 * set_.contacts.size()), handleColumn() + 6);
    for (std::size_t i = 0; i < set_.contacts.size(); ++i) {
      const ContactPoint& p = set_.contacts[i].first;
      for (int k = 0; k < 4; ++k) {
        const int row = tool_.row()[p.node[k]];
        const MatX block = row >= 0 ? MatX(Mat3::Identity()) : MatX(jacobian(p.node[k], pose));
        j.block(static_cast<Eigen::Index>(3 * i), row >= 0 ? 3 * row : handleColumn(), 3, block.cols()) +=
            p.weight[k] * set_.contacts[i].frame() * block;
      }
    }
    return j;
  }

  VecX gaps(const VecX& x) const {
    VecX g(static_cast<Eigen::Index>(set_.contacts.size()));
    for (std::size_t i = 0; i < set_.contacts.size(); ++i) {
      const ContactPoint& p = set_.contacts[i].first;
      g[static_cast<Eigen::Index>(i)] = set_.contacts[i].gap;
      for (int k = 0; k < 4; ++k) {
        const Vec3 moved = x.segment<3>(3 * p.node[k]) - tool_.startPositions().segment<3>(3 * p.node[k]);
        g[static_cast<Eigen::Index>(i)] += p.weight[k] * set_.contacts[i].normal.dot(moved);
      }
    }
    return g;
  }

  // Newton on the equalities that the contacts' states say; linear but for sliding on the exact cone.
  VecX solveStates(const MatX& w, const VecX& free, const VecX& gap) const {
    const double h = tool_.input().step;
    const int facets = world_.contact.cone.facets;
    VecX lambda = set_.impulse;
    const Eigen::Index rows = lambda.size();
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
        r[i] = velocity[i] + gap[i / 3] / h;
        by_velocity(i, i) = 1;
        if (s.state == ContactState::open) {
          r.segment<3>(i) = lambda.segment<3>(i);
          by_velocity(i, i) = 0;
          by_lambda.block<3, 3>(i, i).setIdentity();
        } else if (s.state == ContactState::stick) {
          r.segment<2>(i + 1) = vt;
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
      const MatX jacobian = by_velocity * w + by_lambda;
      Eigen::CompleteOrthogonalDecomposition<MatX> solver;
      solver.setThreshold(1e-10);
      solver.compute(jacobian);
      const VecX step = solver.solve(r);
      lambda -= step;
      if (step.norm() <= 1e-14 * lambda.norm()) break;
    }
    return lambda;
  }

  Vec6 wrench(const Pose& pose, const VecX& f, const VecX& v, const VecX& lambda, const MatX& j) const {
    const Body& t = tool_;
    const double time = t.input().step + t.elasticity().material().damping_beta;
    VecX end = f;
    const Vec6 u = v.tail<6>();
    for (std::size_t e = 0; e < stiffness_.size(); ++e) {
      const auto& node = t.elasticity().elements()[e].node;
      Vec12 velocity;
      for (int k = 0; k < 4; ++k) {
        const int row = t.row()[node[k]];
        velocity.segment<3>(3 * k) = row >= 0 ? Vec3(v.segment<3>(3 * row)) : Vec3(jacobian(node[k], system_pose_) * u);
      }
      const Vec12 force = -time * (rotatedStiffness(e) * velocity);
      for (int k = 0; k < 4; ++k) end.segment<3>(3 * node[k]) += force.segment<3>(3 * k);
    }
    Vec6 out = j.rightCols<6>().transpose() * lambda / t.input().step;
    for (std::size_t k = 0; k < t.handle().nodes.size(); ++k) {
      const Vec3 force = end.segment<3>(3 * t.handle().nodes[k]);
      out.head<3>() += force;
      out.tail<3>() += (pose.rotation * t.handle().offsets[k]).cross(force);
    }
    return out;
  }

  const World& world_;
  const Body& tool_;
  const ContactSet& set_;
  bool frozen_;
  std::vector<Mat12> stiffness_;
  std::vector<Mat3> rotation_;
  Eigen::SimplicialLDLT<Sparse> solver_;
  Mat3 inertia_ = Mat3::Zero();
  Pose system_pose_;
};

void centralDifferences(SlowStep& step, const Body& tool, double length, Mat6& kx, Mat6& kv) {
  const double translation = 1e-5 * length;
  const double rotation = 1e-5;
  for (int k = 0; k < 6; ++k) {
    Vec6 d = Vec6::Zero();
    d[k] = k < 3 ? translation : rotation;
    kx.col(k) = (step.force(advance(tool.startPose(), d), tool.startTwist()) -
                 step.force(advance(tool.startPose(), -d), tool.startTwist())) /
                (2 * d[k]);
    d[k] = k < 3 ? 1e-3 : 1e-3 / length;
    kv.col(k) =
        (step.force(tool.startPose(), tool.startTwist() + d) - step.force(tool.startPose(), tool.startTwist() - d)) /
        (2 * d[k]);
  }
}

double halfDiagonal(const Body& tool) {
  Vec3 low = Vec3::Constant(1e300);
  Vec3 high = Vec3::Constant(-1e300);
  for (const Vec3& p : tool.mesh().surface.vertices) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return 0.5 * (high - low).norm();
}

}  // namespace

double BlockErrors::worst() const { return *std::max_element(block.begin(), block.end()); }

BlockErrors compareBlocks(const Mat6& model, const Mat6& reference, double length) {
  Mat6 scaled_reference = reference;
  Mat6 difference = model - reference;
  for (Mat6* m : {&scaled_reference, &difference}) {
    m->rightCols<3>() /= length;
    m->bottomRows<3>() /= length;
  }
  BlockErrors errors;
  const double floor = 1e-6 * scaled_reference.norm();
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
  const Body& tool = world.tool();
  const ContactSet& set = world.toolContacts();
  const HandleModel model = linearize(world, settings, 0.0);
  const double length = halfDiagonal(tool);
  LinearizationCheck out;
  out.active = set.active();
  out.sticking = set.count(ContactState::stick);
  out.sliding = out.active - out.sticking;
  Mat6 kx, kv;
  SlowStep frozen(world, true);
  centralDifferences(frozen, tool, length, kx, kv);
  out.kx_frozen = compareBlocks(model.kx, kx, length);
  out.kv_frozen = compareBlocks(model.kv, kv, length);
  const Vec6 force = frozen.force(tool.startPose(), tool.startTwist());
  out.force_error = (force - model.force).norm() / std::max(force.norm(), 1e-12);
  SlowStep full(world, false);
  centralDifferences(full, tool, length, kx, kv);
  out.kx_full = compareBlocks(model.kx, kx, length);
  out.kv_full = compareBlocks(model.kv, kv, length);
  return out;
}

}  // namespace palpate
