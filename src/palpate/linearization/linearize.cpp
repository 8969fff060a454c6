#include "palpate/linearization/linearize.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <vector>

#include "palpate/linearization/coupling_derivative.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

using Mat6X = Eigen::Matrix<double, 6, Eigen::Dynamic>;
using ConstMap = Eigen::Ref<const MatX>;
using Mat612 = Eigen::Matrix<double, 6, 12>;  // columns: six by pose, six by twist

/// -dr/dinput of the handle's rows at fixed u, v_t, lambda, without the tool's elastic forces.
struct HandleInputs {
  Mat6 pose = Mat6::Zero();
  Mat6 twist = Mat6::Zero();
};

// Derivative of leftJacobianInverseCurvature by the angle x
double jacobianCurvatureSlope(double x) {
  if (x < 0.05) return x / 360.0 + x * x * x / 7560.0;
  const double s = std::sin(x);
  const double denominator = 2.0 * x * s;
  const double slope = 2.0 * s + 2.0 * x * std::cos(x);
  return -2.0 / (x * x * x) + (s * denominator + (1.0 + std::cos(x)) * slope) / (denominator * denominator);
}

// d/dtheta of sym(Jl^-1(theta)) w = w + c(|theta|) theta x (theta x w)
Mat3 linkJacobianDerivative(const Vec3& theta, const Vec3& w) {
  const double angle = theta.norm();
  const double c = leftJacobianInverseCurvature(theta.squaredNorm());
  Mat3 d = c * (-skew(theta.cross(w)) - skew(theta) * skew(w));
  if (angle > 1e-12) {
    d += jacobianCurvatureSlope(angle) / angle * theta.cross(theta.cross(w)) * theta.transpose();
  }
  return d;
}

HandleInputs handleInputs(const Body& tool, Derivative derivative) {
  HandleInputs out;
  const StepInput& input = tool.input();
  const double h = input.step;
  const Mat3 r = tool.startPose().matrix();
  const Mat3 inertia = r * tool.handle().inertia * r.transpose();
  const Vec3 w0 = tool.startTwist().tail<3>();
  const Vec3 w = tool.endTwist().tail<3>();
  const Vec3 theta = logRotation(tool.startPose().rotation * input.device.pose.rotation.conjugate());
  const Mat3 jacobian = leftJacobianInverse(theta);

  out.pose.topLeftCorner<3, 3>() = -h * input.link.stiffness * Mat3::Identity();
  // gyroscopic term -w0 x I w0, with I = R I R^T turning
  Mat3 turn = -h * input.link.rotational_stiffness * jacobian +
              h * (skew(w0) * skew(inertia * w0) - skew(w0) * inertia * skew(w0));
  if (derivative == Derivative::full) {
    // M_h (u - u0) and the damping alpha of the attached mass, with their inertias turning
    const auto inertiaTurn = [](const Mat3& i, const Vec3& a) -> Mat3 { return -skew(i * a) + i * skew(a); };
    turn -= inertiaTurn(inertia, w - w0);
    turn -= h * tool.elasticity().material().damping_alpha *
            inertiaTurn(r * tool.handle().attached_inertia * r.transpose(), w);
    turn -= h * h * input.link.rotational_stiffness * linkJacobianDerivative(theta, w) * jacobian;
  }
  out.pose.bottomRightCorner<3, 3>() = turn;
  out.twist = tool.handleMassAtStart();
  out.twist.bottomRightCorner<3, 3>() += h * (skew(inertia * w0) - skew(w0) * inertia);
  return out;
}

/// Contact on the handle's part of the surface: how its rows and its wrench turn with the handle.
struct HandleContactTurn {
  MatX rows;                   ///< d(J_h) u by pose, rows x 6
  Mat6 wrench = Mat6::Zero();  ///< d(J_h^T) lambda by pose
};

HandleContactTurn handleContactTurn(const Body& tool, const ContactSet& set, const std::vector<int>& own, int self) {
  HandleContactTurn out;
  out.rows.setZero(static_cast<Eigen::Index>(3 * own.size()), 6);
  const Mat3 r = tool.startPose().matrix();
  const Vec3 w = tool.endTwist().tail<3>();
  for (std::size_t k = 0; k < own.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(3 * k);
    const int i = own[k];
    const Mat3 frame = set.contacts[i].frame();
    const Vec3 impulse = frame.transpose() * set.impulse.segment<3>(3 * i);
    const auto addPoint = [&](const ContactPoint& point, double sign) {
      if (point.body != self) return;
      for (int n = 0; n < point.count; ++n) {
        const int index = tool.attachedIndex()[point.node[n]];
        if (index < 0) continue;
        const Mat3 lever = skew(r * tool.handle().offsets[index]);
        out.rows.block<3, 3>(row, 3) -= sign * point.weight[n] * frame * skew(w) * lever;
        out.wrench.bottomRightCorner<3, 3>() += sign * point.weight[n] * skew(impulse) * lever;
      }
    };
    addPoint(set.contacts[i].first, 1.0);
    addPoint(set.contacts[i].second, -1.0);
  }
  return out;
}

// Active contacts whose normal rows are independent: pivoted Cholesky of W_nn, dropping what others determine to a
// tenth. Of W the lower triangle is read.
std::vector<char> wellConditioned(const std::vector<ContactStatus>& status, const MatX& delassus) {
  constexpr double kIndependent = 0.1;  // of the contact's own compliance, once those chosen before it are held
  std::vector<int> active;
  for (std::size_t i = 0; i < status.size(); ++i) {
    if (status[i].state != ContactState::open) active.push_back(static_cast<int>(i));
  }
  const auto n = static_cast<Eigen::Index>(active.size());
  std::vector<char> chosen(status.size(), 0);
  if (n == 0) return chosen;
  VecX rest(n);
  for (Eigen::Index i = 0; i < n; ++i) rest[i] = delassus(3 * active[i], 3 * active[i]);
  const VecX full = rest;
  MatX factor(n, n);
  for (Eigen::Index k = 0; k < n; ++k) {
    Eigen::Index pivot = 0;
    const double share = rest.cwiseQuotient(full.cwiseMax(1e-300)).maxCoeff(&pivot);
    if (!(share > kIndependent)) break;
    chosen[active[pivot]] = 1;
    for (Eigen::Index i = 0; i < n; ++i) {
      factor(i, k) = delassus(3 * std::max(active[i], active[pivot]), 3 * std::min(active[i], active[pivot]));
    }
    if (k > 0) factor.col(k) -= factor.leftCols(k) * factor.row(pivot).head(k).transpose();
    factor.col(k) /= std::sqrt(rest[pivot]);
    rest -= factor.col(k).cwiseAbs2();
    rest[pivot] = 0;
  }
  return chosen;
}

// Active contacts of the island that the tool's motion reaches: its own, those of the bodies that it touches, and so
// on. Contacts that are open connect nothing here.
std::vector<char> reached(const ContactSet& set, const std::vector<int>& island, int tool) {
  std::vector<int> bodies{tool};
  std::vector<char> out(island.size(), 0);
  const auto known = [&](const ContactPoint& point) {
    return point.body >= 0 && std::find(bodies.begin(), bodies.end(), point.body) != bodies.end();
  };
  for (std::size_t before = 0; before < bodies.size();) {
    before = bodies.size();
    for (std::size_t i = 0; i < out.size(); ++i) {
      const Contact& c = set.contacts[island[i]];
      if (out[i] || set.status[island[i]].state == ContactState::open || !(known(c.first) || known(c.second))) continue;
      out[i] = 1;
      for (const ContactPoint* point : {&c.first, &c.second}) {
        if (point->body >= 0 && !known(*point)) bodies.push_back(point->body);
      }
    }
  }
  return out;
}

// dlambda for given changes of the rows' free velocity and of the constraint, [rows x 12]. Of W the lower triangle of
// the contacts' own blocks is read, for the exact model all of it.
MatX impulseResponse(const ContactResponse& law, const MatX& delassus, DelassusModel model, const MatX& free_change,
                     const MatX& given) {
  const Eigen::Index n = law.d.size();
  const auto row = [&](Eigen::Index k) { return static_cast<Eigen::Index>(3 * law.contact[k]); };
  const auto compliance = [&](Eigen::Index k) -> Mat3 {
    return delassus.block<3, 3>(row(k), row(k)).selfadjointView<Eigen::Lower>();
  };
  MatX right(n, 12);
  for (Eigen::Index k = 0; k < n; ++k) {
    right.row(k) = law.c.col(k).transpose() * (given.middleRows<3>(row(k)) - free_change.middleRows<3>(row(k)));
  }
  MatX y(n, 12);
  if (model == DelassusModel::diagonal) {
    for (Eigen::Index k = 0; k < n; ++k) {
      y.row(k) = right.row(k) / (law.c.col(k).dot(compliance(k) * law.b.col(k)) + law.d[k]);
    }
  } else {
    MatX q(n, n);
    VecX column(delassus.rows());
    for (Eigen::Index l = 0; l < n; ++l) {
      column.noalias() = delassus.middleCols<3>(row(l)) * law.b.col(l);
      for (Eigen::Index k = 0; k < n; ++k) q(k, l) = law.c.col(k).dot(column.segment<3>(row(k)));
    }
    // Redundant contacts leave q singular but consistent: a shift far below the contact's own compliance changes no
    // force. Not relative to D, which is huge where a contact slides fast under next to no force.
    constexpr double kShift = 1e-11;
    for (Eigen::Index k = 0; k < n; ++k) {
      q(k, k) += law.d[k] + kShift * law.c.col(k).dot(compliance(k) * law.c.col(k));
    }
    y = q.partialPivLu().solve(right);
  }
  MatX dlambda = MatX::Zero(free_change.rows(), 12);
  for (Eigen::Index k = 0; k < n; ++k) dlambda.middleRows<3>(row(k)) += law.b.col(k) * y.row(k);
  return dlambda;
}

// Rows of `own` contacts at their place among the rows of the given `list`, [rows x columns]; both increasing.
MatX spread(const ConstMap& rows, const std::vector<int>& own, const std::vector<int>& list) {
  if (own.size() == list.size()) return rows;
  MatX out = MatX::Zero(static_cast<Eigen::Index>(3 * list.size()), rows.cols());
  std::size_t at = 0;
  for (std::size_t k = 0; k < own.size(); ++k, ++at) {
    while (list[at] != own[k]) ++at;
    out.middleRows<3>(static_cast<Eigen::Index>(3 * at)) = rows.middleRows<3>(static_cast<Eigen::Index>(3 * k));
  }
  return out;
}

}  // namespace

ContactResponse contactResponse(const ContactSet& set, const std::vector<int>& list, const std::vector<char>& used,
                                const FrictionCone& cone, const VecX& row_velocity) {
  ContactResponse out;
  const auto capacity = static_cast<Eigen::Index>(3 * list.size());
  out.b.resize(3, capacity);
  out.c.resize(3, capacity);
  out.d.resize(capacity);
  Eigen::Index n = 0;
  for (std::size_t at = 0; at < list.size(); ++at) {
    if (!used[at]) continue;
    const auto row = static_cast<Eigen::Index>(3 * at);
    const int i = list[at];
    const double mu = set.contacts[i].friction;
    const Vec3 normal = Vec3::UnitX();
    const auto add = [&](const Vec3& b, const Vec3& c, double d) {
      out.contact.push_back(static_cast<int>(at));
      out.b.col(n) = b;
      out.c.col(n) = c;
      out.d[n++] = d;
    };
    switch (set.status[i].state) {
      case ContactState::open:
        break;
      case ContactState::stick:
        for (int k = 0; k < 3; ++k) add(Vec3::Unit(k), Vec3::Unit(k), 0.0);
        break;
      case ContactState::vertex:
        add(normal + mu * vertexDirection(set.status[i].index, cone.facets), normal, 0.0);
        break;
      case ContactState::edge: {
        const double apothem = mu * std::cos(M_PI / cone.facets);
        const Vec3 along = edgeTangent(set.status[i].index, cone.facets);
        add(normal + apothem * edgeNormal(set.status[i].index, cone.facets), normal, 0.0);
        add(along, along, 0.0);
        break;
      }
      case ContactState::slide: {
        const double normal_impulse = set.impulse[3 * i];
        const Vec3 slip(0, row_velocity[row + 1], row_velocity[row + 2]);
        const double speed = slip.norm();
        if (mu == 0 || speed == 0 || normal_impulse <= 0) {
          add(normal, normal, 0.0);
          break;
        }
        // lambda_t = -mu lambda_n t with t = slip / speed: across t it turns with the slip,
        // dlambda_t = -(mu lambda_n / speed) (I - t t^T) dslip
        const Vec3 along = slip / speed;
        const Vec3 across(0, -along.z(), along.y());
        add(normal - mu * along, normal, 0.0);
        add(across, across, speed / (mu * normal_impulse));
        break;
      }
    }
  }
  out.b.conservativeResize(Eigen::NoChange, n);
  out.c.conservativeResize(Eigen::NoChange, n);
  out.d.conservativeResize(n);
  return out;
}

namespace {

Vec6 withHandleContact(const World& world, Vec6 wrench) {
  const ContactSet& set = world.contacts();
  const int tool = world.toolRows();
  if (tool < 0 || set.contacts.empty() || set.rows[tool].contacts.empty()) return wrench;
  const Body::ContactRows& rows = set.rows[tool];
  return wrench + rows.handle * rows.gather(set.impulse) / world.tool().input().step;
}

}  // namespace

Vec6 couplingWrench(const World& world) { return withHandleContact(world, couplingForces(world.tool()).wrench); }

HandleModel linearize(World& world, const LinearizationSettings& settings, double time) {
  Body& tool = world.tool();
  const ContactSet& set = world.contacts();
  const double h = tool.input().step;
  const double stiffness_time = h + tool.elasticity().material().damping_beta;
  const bool full = settings.derivative == Derivative::full;
  const bool touching = set.active() > 0 && world.toolRows() >= 0 && !set.rows[world.toolRows()].contacts.empty();
  const Body::ContactRows* own = touching ? &set.rows[world.toolRows()] : nullptr;
  const CouplingForces forces = couplingForces(tool);
  const HandleInputs inputs = handleInputs(tool, settings.derivative);

  // Steps 2 and 3: derivatives of the right-hand sides. The tool's frozen part is -h K_TH G = -A_th h / c.
  const double scale = -h / tool.stiffnessScale();
  const Mat6 q = tool.coupling().transpose() * tool.response();  // A_ht A_tt^-1 A_th
  Mat6 tool_part = scale * q;                                    // X^T db_t by pose
  Mat6 handle_part = inputs.pose - h * tool.handleStiffness() + h * forces.lever_start;
  Mat6 force_part = -tool.handleStiffness() + forces.lever_end;  // dFc/dpose at fixed u, v_t
  MatX extra_rows;  // J_t A_tt^-1 of the full derivative's extra columns, of the tool's contacts
  HandleContactTurn turn;
  if (full) {
    const RotationTerms terms = rotationTerms(tool);
    MatX response = h * terms.free;
    tool_part += tool.response().transpose() * response;
    handle_part += h * (terms.handle + forces.lever_end - forces.lever_start);
    force_part += terms.handle;
    if (touching) {
      turn = handleContactTurn(tool, set, own->contacts, world.toolIndex());
      handle_part += turn.wrench;
      force_part += turn.wrench / h;
      tool.factor().solve(response);
      extra_rows = tool.rowVelocity(set.contacts, own->contacts, world.toolIndex(), response);
    }
  }
  Mat612 b_h;
  b_h.leftCols<6>() = handle_part;
  b_h.rightCols<6>() = inputs.twist;
  Mat612 x_b = Mat612::Zero();
  x_b.leftCols<6>() = tool_part;

  // Step 4: derivatives of the velocities, without and then with the active contacts' impulses. Of v_t only A_ht v_t is
  // needed, and X gives it.
  Mat612 du = tool.handleSchurInverse() * (b_h - x_b);
  Mat612 a_ht_dv = x_b;
  Mat612 handle_dlambda = Mat612::Zero();  // J_h^T dlambda
  if (touching) {
    // `hsl`: of the tool's contacts and its own part of W. With contacts decoupled from each other, other bodies drop
    // out of the model (paper, section 3.5): they are taken to go their way whatever the tool does. Their compliance
    // alone, without what holds them, would let a body that stands on the ground float away under the tool.
    // `hsl-exact`: of the tool's island, as through W a contact of the tool answers for those of the bodies that it
    // pushes. What other islands do does not depend on the handle.
    const bool diagonal = settings.delassus == DelassusModel::diagonal;
    const ContactIsland& island = set.islands[set.island[own->contacts.front()]];
    const std::vector<int>& list = diagonal ? own->contacts : island.contacts;
    const MatX& delassus = diagonal ? own->delassus : island.delassus;
    const Mat6X handle = spread(own->handle.transpose(), own->contacts, list).transpose();
    const Mat6X z = spread(own->z.transpose(), own->contacts, list).transpose();
    const Mat6X j_t_x = handle - z;  // (J_t X)^T
    MatX free_change = z.transpose() * du;
    free_change.leftCols<6>() += scale * j_t_x.transpose();
    MatX given = MatX::Zero(free_change.rows(), 12);
    for (Eigen::Index r = 0; r < given.rows(); r += 3) {
      if (!set.contacts[list[r / 3]].capped) given.row(r).head<6>() = -handle.col(r).transpose() / h;
    }
    if (full) {
      free_change.leftCols<6>() += spread(extra_rows, own->contacts, list);
      given.leftCols<6>() -= spread(turn.rows, own->contacts, list);
    }
    const VecX island_velocity = set.rowVelocity(island);
    VecX row_velocity(static_cast<Eigen::Index>(3 * list.size()));
    std::vector<ContactStatus> status;
    for (std::size_t k = 0; k < list.size(); ++k) {
      row_velocity.segment<3>(static_cast<Eigen::Index>(3 * k)) = island_velocity.segment<3>(3 * set.place[list[k]]);
      status.push_back(set.status[list[k]]);
    }
    const std::vector<char> used = diagonal ? wellConditioned(status, delassus) : reached(set, list, world.toolIndex());
    const ContactResponse law = contactResponse(set, list, used, world.contact.cone, row_velocity);
    const MatX dlambda = impulseResponse(law, delassus, settings.delassus, free_change, given);
    handle_dlambda = handle * dlambda;
    du += tool.handleSchurInverse() * (z * dlambda);
    a_ht_dv += j_t_x * dlambda;
  }
  a_ht_dv -= q * du;

  // Steps 5 and 6: of the coupling wrench. (h K_HT + D_HT) v_t = A_ht v_t / h.
  Mat612 df = -stiffness_time * tool.handleStiffness() * du - a_ht_dv / h;
  df.leftCols<6>() += force_part;
  df += handle_dlambda / h;

  HandleModel model;
  model.force = withHandleContact(world, forces.wrench);
  model.pose = tool.startPose();
  model.twist = tool.startTwist();
  model.kx = df.leftCols<6>();
  model.kv = df.rightCols<6>();
  model.handle_pose = advance(tool.startPose(), h * tool.endTwist());
  model.handle_twist = tool.endTwist();
  model.time = time;
  model.step = h;
  return model;
}

}  // namespace palpate
