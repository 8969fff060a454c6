#include "palpate/reduction/reduce.h"

#include <algorithm>
#include <cmath>

#include "palpate/common/parallel.h"
#include "palpate/common/scoped_timer.h"
#include "palpate/contact/surface_bend.h"
#include "palpate/math/decompositions.h"
#include "palpate/math/rotation.h"
#include "palpate/math/segment.h"
#include "palpate/reduction/flat_tool.h"
#include "palpate/reduction/modes.h"
#include "palpate/reduction/partner_reduction.h"

namespace palpate {
namespace {

constexpr double kLeastCompliance = 1e-7, kMostShift = 1.0;  // [m/N]
constexpr double kMostFacet = 0.1;                           // [rad]: by which a point's normal is turned
constexpr double kMostRise = 1e-3;                           // [m]

double horizonOf(const LiveSettings& settings, double step) { return std::max(settings.horizon, step); }

// Of the damped force of a point's track, shared out among those points of it that carry force.
Vec3 dampedShare(const DampedForces& damped, const std::vector<TouchPoint>& points, const TouchPoint& point) {
  const double own = point.force.norm();
  if (own == 0) return Vec3::Zero();
  const auto found =
      std::find_if(damped.begin(), damped.end(), [&](const auto& d) { return d.first == point.contact.track; });
  if (found == damped.end()) return Vec3::Zero();
  double all = 0;
  for (const TouchPoint& p : points) all += p.contact.track == point.contact.track ? p.force.norm() : 0.0;
  return own / all * found->second;
}

// Spheres and capsules give their normals anew in each tick. Their gap at this place is the contact's, whose surface is
// of triangles and keeps its distance.
void setRound(const Obstacle& obstacle, const Vec3& place, double gap, LiveSurface& surface) {
  if (const auto* sphere = std::get_if<SphereShape>(&obstacle.shape)) {
    surface.a = surface.b = sphere->center;
  } else if (const auto* capsule = std::get_if<CapsuleShape>(&obstacle.shape)) {
    surface.a = capsule->a;
    surface.b = capsule->b;
  } else {
    return;
  }
  surface.kind = LiveSurface::Kind::capsule;
  const double along = closestOnSegment(place, surface.a, surface.b);
  surface.offset = (place - surface.a - along * (surface.b - surface.a)).norm() - gap;
}

// Bends the plane of a cluster as the obstacle's triangles are bent around it. On a round wall,
// - each point has the normal of a facet or an edge: it is turned to what it is at the point itself, as one that the
//   point has left by now would push it on;
// - the mean of the points is in front of the wall, and what turns there has too short a lever: it is put back;
// - the normals add up to less than one, but the friction of all the forces is there.
// @param place     of the cluster on the tool, is moved with the plane [m]
// @param friction  of the cluster
void bendPlane(const World& world, const std::vector<TouchPoint>& points, const TouchCluster& cluster,
               LiveSurface& surface, Vec3& place, double& friction) {
  std::vector<SurfaceFeature> features;
  std::vector<int> triangles;
  for (const auto& [index, weight] : cluster) {
    features.push_back(world.featureOn(-1, points[static_cast<std::size_t>(index)].contact));
    if (features.back().surface != features.front().surface) return;
    triangles.insert(triangles.end(), features.back().triangles.begin(), features.back().triangles.end());
  }
  if (features.front().surface == nullptr) return;
  const Mat3 bend = surfaceBend(*features.front().surface, triangles, surface.a, surface.normal);
  if (bend.isZero(0.0)) return;
  Vec3 sum = Vec3::Zero();
  double rise = 0;
  for (std::size_t k = 0; k < cluster.size(); ++k) {
    const auto& [index, weight] = cluster[k];
    const TouchPoint& p = points[static_cast<std::size_t>(index)];
    const Vec3 foot = p.place - p.gap * p.contact.normal, d = foot - surface.a;
    const Vec3 turn = bend * (foot - features[k].middle());
    const double size = turn.norm();
    sum += weight * (p.contact.normal + kMostFacet / std::max(size, kMostFacet) * turn).normalized();
    rise -= 0.5 * weight * d.dot(bend * d);
  }
  const double length = sum.norm();
  surface.normal = sum / length;
  const Mat3 flat = Mat3::Identity() - surface.normal * surface.normal.transpose();
  surface.bend = flat * bend * flat;
  const Vec3 back = std::clamp(rise, -kMostRise, kMostRise) * surface.normal;
  surface.a -= back;
  place -= back;
  friction /= length;
}

}  // namespace

ToolShape toolShape(const World& world) {
  const Body tool = world.tool();
  const VecX places = tool.model.placesInHandle(tool.state);
  ToolShape shape{VecX(3 * tool.model.freeNodes()), tool.model.speedsInHandle(tool.state, places)};
  for (int r = 0; r < tool.model.freeNodes(); ++r) {
    shape.places.segment<3>(3 * r) = places.segment<3>(3 * tool.model.free()[r]);
  }
  return shape;
}

VecX freeMasses(const BodyModel& tool) {
  VecX mass(3 * tool.freeNodes());
  for (int r = 0; r < tool.freeNodes(); ++r) {
    mass.segment<3>(3 * r).setConstant(tool.elasticity().mass()[tool.free()[r]]);
  }
  return mass;
}

namespace {

// All nodes in the handle's frame.
VecX allPlaces(const Body& tool, const ToolShape& shape) {
  VecX places = tool.model.placesInHandle(tool.state);
  for (int r = 0; r < tool.model.freeNodes(); ++r) {
    places.segment<3>(3 * tool.model.free()[r]) = shape.places.segment<3>(3 * r);
  }
  return places;
}

}  // namespace

// Everything in the handle's frame: the elastic forces turn with the tool. The tool's system keeps what the next step
// can use.
bool ToolReduction::prepare(World& world, const LiveSettings& settings, const ToolShape& shape, double step) {
  const Body tool = world.tool();
  return tool.system.prepareFollowing(allPlaces(tool, shape), tool.state, horizonOf(settings, step));
}

// What the tool touches or soon may.
const std::vector<TouchPoint>& ToolReduction::search(World& world, const LiveSettings& settings,
                                                     const ToolShape& shape) {
  const ScopedTimer timer(times_.search);
  const Body tool = world.tool();
  const Pose& pose = tool.state.handle.pose;
  const Mat3 rotation = pose.matrix();
  const Vec6& twist = tool.state.handle.twist;
  World::ToolMotion motion{VecX(3 * tool.model.nodes()), VecX(3 * tool.model.nodes())};  // in the world
  for (int i = 0; i < tool.model.nodes(); ++i) {
    const Vec3 y = positions_.segment<3>(3 * i);
    motion.positions.segment<3>(3 * i) = pose.apply(y);
    Vec3 v = twist.head<3>() + twist.tail<3>().cross(rotation * y);
    const int row = tool.model.row()[i];
    if (row >= 0) v += rotation * shape.speeds.segment<3>(3 * row);
    motion.speeds.segment<3>(3 * i) = v;
  }
  const int most = std::clamp(settings.contacts, 0, LiveSize::kContacts);
  return findTouchPoints(world, motion, {settings.margin, settings.lookahead, most}, near_);
}

bool ToolReduction::factorize(World& world, const LiveSettings& settings, const Input& input, LiveModel& model) {
  const ScopedTimer timer(times_.factorize);
  const Body tool = world.tool();
  if (!tool.system.prepareFollowing(positions_, tool.state, horizonOf(settings, input.step))) return false;
  const Material& material = tool.model.elasticity().material();
  const PreparedFollowing& prepared = tool.system.prepared();
  mass_scale_ = material.massScale(prepared.step);
  e_ = material.stiffnessScale(prepared.step);
  mass_ = freeMasses(tool.model);
  factor_ = &tool.system.factor();
  matrix_ = &tool.system.matrix();
  model.elastic_energy = prepared.energy;
  forces_ = prepared.elastic.forces;
  elastic_ = {prepared.elastic.rotations, tool.state.elastic.stiffness_scale, {}, prepared.elastic.released};
  return true;
}

void ToolReduction::findToolModes(const Input& input, int most, LiveBasis& basis, LiveModel& model) {
  const ScopedTimer timer(times_.modes);
  const int wanted = std::clamp(most, 0, LiveSize::kToolModes);
  const Modes modes = findModes({mass_.size(), mass_scale_, e_, [&](MatX& columns) { factor_->solve(columns); },
                                 [&](const MatX& columns) { return MatX(mass_.asDiagonal() * columns); }, matrix_},
                                input.start, wanted);
  // what the subspace iteration has beyond the wanted modes only helps it on
  const Eigen::Index r = std::min<Eigen::Index>(wanted, modes.shapes.cols());
  basis.modes = modes.shapes.leftCols(r);
  basis.places = input.shape.places;
  basis.partners.clear();
  model.squared_frequency = modes.squared_frequency.head(r);
  model.damping = (model.alpha + model.beta * model.squared_frequency.array()).matrix();
}

// All of it is sums of the modes' coordinates, weighed by m and m y: y x (e_k x q) = e_k (y . q) - q (y . e_k).
void ToolReduction::addInertia(const World& world, const Input& input, LiveBasis& basis, LiveModel& model) {
  const ScopedTimer timer(times_.modes);
  const Body tool = world.tool();
  const Handle& handle = tool.model.handle();
  const Eigen::Index n = tool.model.freeNodes(), r = basis.modes.cols();
  Eigen::Matrix<double, Eigen::Dynamic, 4> weight(n, 4);
  Mat3 second = Mat3::Zero();
  for (Eigen::Index i = 0; i < n; ++i) {
    const Vec3 y = basis.places.segment<3>(3 * i);
    const double m = mass_[3 * i];
    weight.row(i) << m, m * y.transpose();
    second += (m * y) * y.transpose();
  }
  model.mass = handle.mass + weight.col(0).sum();
  model.moment = weight.rightCols<3>().colwise().sum().transpose();
  model.inertia << model.mass * Mat3::Identity(), -skew(model.moment), skew(model.moment),
      handle.inertia + second.trace() * Mat3::Identity() - second;

  std::array<MatX, 3> q;                                      // the modes' coordinates
  std::array<Eigen::Matrix<double, 4, Eigen::Dynamic>, 3> p;  // their weighed sums
  for (int b = 0; b < 3; ++b) {
    q[b] = basis.modes(Eigen::seqN(b, n, Eigen::fix<3>), Eigen::all);
    p[b] = weight.transpose() * q[b];
  }
  const auto product = [&](int a, int b) { return p[b].row(1 + a); };  // sum m y_a q_b
  const VecX inner = (product(0, 0) + product(1, 1) + product(2, 2)).transpose();
  model.coupling.setZero(6, r);
  model.centrifugal.setZero(r, 6);
  for (int k = 0; k < 3; ++k) {
    const int a = (k + 1) % 3, b = (k + 2) % 3;
    model.coupling.row(k) = p[k].row(0);
    model.coupling.row(3 + k) = product(a, b) - product(b, a);
    // w x (w x y) = w (w . y) - y (w . w)
    model.centrifugal.col(k) = product(k, k).transpose() - inner;
    model.centrifugal.col(5 - k) = (product(a, b) + product(b, a)).transpose();
    model.coriolis_torque[k].setZero(3, r);
    model.coriolis_torque[k].row(k) = inner.transpose();
    for (int c = 0; c < 3; ++c) model.coriolis_torque[k].row(c) -= product(k, c);
    const MatX across = q[b].transpose() * (weight.col(0).asDiagonal() * q[a]);
    model.coriolis[k] = across - across.transpose();
  }
  model.speed = basis.project(mass_, input.shape.speeds);
  VecX force(basis.modes.rows());
  for (int i = 0; i < tool.model.freeNodes(); ++i) {
    force.segment<3>(3 * i) = forces_.segment<3>(3 * tool.model.free()[i]);
  }
  basis.force = basis.modes.transpose() * force;
  model.force = basis.force;
}

namespace {

void appendTo(ModalVector& all, const VecX& more) {
  const Eigen::Index r = all.size();
  all.conservativeResize(r + more.size());
  all.tail(more.size()) = more;
}

// One more column for each mode of another body, which has neither inertia with the handle nor spin.
void widen(LiveModel& model, Eigen::Index more) {
  const Eigen::Index r = model.coupling.cols(), all = r + more;
  const auto grow = [](auto& matrix, Eigen::Index rows, Eigen::Index columns) {
    const auto before = matrix.eval();
    matrix.setZero(rows, columns);
    matrix.topLeftCorner(before.rows(), before.cols()) = before;
  };
  grow(model.coupling, 6, all);
  grow(model.centrifugal, all, 6);
  grow(model.shape, model.shape.rows(), all);
  for (int k = 0; k < 3; ++k) {
    grow(model.coriolis[k], all, all);
    grow(model.coriolis_torque[k], 3, all);
  }
}

// Of a node of another body by its correction.
Vec3 shiftOf(const Body& body, int node, const BodyCorrection& correction) {
  if (body.model.isRigid()) {
    const Vec6 twist = correction.shift;
    return body.model.handle().jacobian(body.model.attachedIndex()[node], body.state.handle.pose) * twist;
  }
  const int row = body.model.row()[node];
  return row >= 0 ? Vec3(correction.shift.segment<3>(3 * row)) : Vec3(Vec3::Zero());
}

using BodySupport = std::pair<int, PartnerSupport>;

// Of the bodies that the tool touches; all of a body's or none, at most so many.
std::vector<BodySupport> supportsOfTouched(const World& world, const std::vector<TouchPoint>& points, int most) {
  constexpr int kOfOne = 3;
  std::vector<BodySupport> out;
  std::vector<char> seen(static_cast<std::size_t>(world.bodies()), 0);
  for (const TouchPoint& p : points) {
    const int b = p.contact.second.body;
    if (p.internal || p.tied || b < 0 || seen[static_cast<std::size_t>(b)]) continue;
    seen[static_cast<std::size_t>(b)] = 1;
    const std::vector<PartnerSupport> own = supportsOf(world, b, kOfOne);
    if (static_cast<int>(out.size() + own.size()) > most) break;
    for (const PartnerSupport& s : own) out.emplace_back(b, s);
  }
  return out;
}

}  // namespace

// What the tool touched it mostly touches still.
void ToolReduction::beginPartners(World& world, const std::vector<PartnerBasis>& partners) {
  begun_.clear();
  for (const PartnerBasis& p : partners) {
    if (PartnerReduction::worthBeginning(world, p.body)) begun_.emplace_back(world, p.body, false);
  }
}

PartnerReduction* ToolReduction::begunPartner(int body) {
  const auto at = std::find_if(begun_.begin(), begun_.end(), [&](const auto& p) { return p.body() == body; });
  return at == begun_.end() ? nullptr : &*at;
}

// With as many modes as each gets where all of them are touched, and nothing else.
void ToolReduction::holdPartners(const LiveSettings& settings, const std::vector<PartnerBasis>& partners) {
  for (const PartnerBasis& p : partners) {
    PartnerReduction* begun = begunPartner(p.body);
    if (begun == nullptr) continue;
    begun->hold(&p.modes,
                std::min(settings.partner_modes, LiveSize::kPartnerModes / static_cast<int>(partners.size())));
  }
}

// What the touched bodies give way, in the world's frame, and their lowest modes.
void ToolReduction::addPartners(World& world, const LiveSettings& settings, const Input& input, LiveBasis& basis,
                                LiveModel& model, MatX& others) {
  const ScopedTimer timer(times_.partners);
  const Mat3 rt = world.tool().state.handle.pose.matrix().transpose();
  int left = LiveSize::kPartnerModes;
  auto waiting = std::count_if(touched_.begin(), touched_.end(), [](const auto& t) { return !t.sums.empty(); });
  for (int b = 0; b < world.bodies(); ++b) {
    const std::vector<NodeSum>& own = touched_[static_cast<std::size_t>(b)].sums;
    if (own.empty()) continue;
    model.partners_yield = true;
    PartnerInput partner{own, touched_[static_cast<std::size_t>(b)].loads, correctionOf(input.corrections, b), nullptr,
                         0};
    const std::vector<PartnerSupport>& supports = touched_[static_cast<std::size_t>(b)].supports;
    if (!supports.empty()) partner.supports = &supports;
    partner.modes = std::min<int>(settings.partner_modes, left / static_cast<int>(waiting--));
    for (const PartnerBasis& p : input.partners) {
      if (p.body == b) partner.start = &p.modes;
    }
    PartnerModes modes = reducePartner(world, b, partner, others, begunPartner(b));
    for (std::size_t s = 0; s < supports.size(); ++s) {
      const int row = own[own.size() - supports.size() + s].row / 3 - (model.contacts - model.supports);
      for (std::size_t k = 0; k < own.size(); ++k) {
        model.bearing.block<1, 3>(row, own[k].row) =
            modes.bearing.block<1, 3>(static_cast<Eigen::Index>(s), static_cast<Eigen::Index>(3 * k)) * rt.transpose();
      }
    }
    const Eigen::Index r = modes.squared_frequency.size();
    if (r == 0) continue;
    left -= static_cast<int>(r);
    modes.basis.first = model.modes();
    widen(model, r);
    for (std::size_t k = 0; k < own.size(); ++k) {
      model.shape.middleRows<3>(own[k].row).rightCols(r) =
          rt * modes.shape.middleRows<3>(static_cast<Eigen::Index>(3 * k));
    }
    appendTo(model.squared_frequency, modes.squared_frequency);
    appendTo(model.damping, modes.damping);
    appendTo(model.force, modes.force - model.shape.rightCols(r).transpose() * model.contact_force);
    appendTo(model.speed, modes.speed);
    model.partner_modes += static_cast<int>(r);
    basis.partners.push_back(std::move(modes.basis));
  }
}

// Of the model: the contacts, what they are with, and what they carry. Nothing of what the tool's modes are in.
void ToolReduction::placeContacts(World& world, const LiveSettings& settings, const Input& input, LiveModel& model) {
  const std::vector<TouchPoint>& points = search(world, settings, input.shape);
  const Body tool = world.tool();
  const Mat3 rt = tool.state.handle.pose.matrix().transpose();
  const int most = std::clamp(settings.contacts, 0, LiveSize::kContacts);
  const std::vector<BodySupport> supports =
      settings.partner_modes > 0 ? supportsOfTouched(world, points, std::min(most / 2, LiveSize::kSupports))
                                 : std::vector<BodySupport>();
  const std::vector<TouchCluster> clusters = clusterTouchPoints(points, most - static_cast<int>(supports.size()));
  const auto m = static_cast<Eigen::Index>(clusters.size() + supports.size());
  model.contacts = static_cast<int>(m);
  model.arm.setZero(3 * m);
  model.damped_force.setZero(3 * m);
  model.contact_force.setZero(3 * m);
  columns_.clear();
  touched_.assign(static_cast<std::size_t>(world.bodies()), {});
  loads_.setZero(3 * tool.model.freeNodes());
  merged_.setZero(3 * m);
  const auto addLoad = [&](const ContactPoint& point, const Vec3& force) {
    for (int k = 0; k < point.count; ++k) {
      const int row = tool.model.row()[point.node[k]];
      if (row >= 0) loads_.segment<3>(3 * row) += point.weight[k] * force;
      model.torque += point.weight[k] * Vec3(positions_.segment<3>(3 * point.node[k])).cross(force);
    }
  };
  const auto addLoads = [&](const TouchPoint& p, double share) {
    const Vec3 force = share * p.force;
    if (force.isZero(0.0)) return;
    addLoad(p.contact.first, rt * force);
    if (p.internal) addLoad(p.contact.second, -(rt * force));
    if (p.internal || p.contact.second.body < 0) return;
    NodeSum sum;
    for (int k = 0; k < p.contact.second.count; ++k) {
      sum.nodes.emplace_back(p.contact.second.node[k], -p.contact.second.weight[k]);
    }
    touched_[static_cast<std::size_t>(p.contact.second.body)].loads.emplace_back(std::move(sum), force);
  };
  for (std::size_t g = 0; g < clusters.size(); ++g) {
    const auto at = static_cast<Eigen::Index>(3 * g);
    LiveSurface& surface = model.surface[g];
    surface = {};
    surface.normal.setZero();
    Vec3 place = Vec3::Zero(), foot = Vec3::Zero();  // of the tool, on the other side
    double friction = 0;
    const TouchPoint& first = points[static_cast<std::size_t>(clusters[g].front().first)];
    const auto addNodes = [&](const ContactPoint& point, double weight) {
      for (int k = 0; k < point.count; ++k) {
        const double share = weight * point.weight[k];
        const int row = tool.model.row()[point.node[k]];
        if (row >= 0) columns_.add(row, share * Mat3::Identity());
        model.arm.segment<3>(at) += share * positions_.segment<3>(3 * point.node[k]);
      }
    };
    NodeSum partner{static_cast<int>(at), {}};
    for (const auto& [index, weight] : clusters[g]) {
      const TouchPoint& p = points[static_cast<std::size_t>(index)];
      addNodes(p.contact.first, weight);
      if (p.internal) addNodes(p.contact.second, -weight);
      surface.normal += weight * p.contact.normal;
      place += weight * p.place;
      foot += weight * (p.tied ? p.contact.second.at(world.body(p.contact.second.body).state.positions)
                               : Vec3(p.place - p.gap * p.contact.normal));
      friction += weight * p.contact.friction;
      model.contact_force.segment<3>(at) += rt * p.force;
      model.damped_force.segment<3>(at) += dampedShare(input.damped, points, p);
      if (p.internal || p.contact.second.body < 0) continue;
      const BodyCorrection* correction = correctionOf(input.corrections, p.contact.second.body);
      for (int k = 0; k < p.contact.second.count; ++k) {
        const int node = p.contact.second.node[k];
        const double share = weight * p.contact.second.weight[k];
        partner.nodes.emplace_back(node, -share);
        if (correction != nullptr) foot += share * shiftOf(world.body(p.contact.second.body), node, *correction);
      }
    }
    columns_.close();
    surface.normal.normalize();
    surface.a = foot;
    model.friction[g] = friction;
    if (first.tied) {
      surface.kind = LiveSurface::Kind::tied;
    } else if (const Obstacle* obstacle = world.obstacleOf(first.contact)) {
      const Vec3 before = place;
      setRound(*obstacle, place, surface.normal.dot(place - foot), surface);
      if (surface.kind == LiveSurface::Kind::plane) {
        bendPlane(world, points, clusters[g], surface, place, model.friction[g]);
      }
      placeOnFlat(world, points, clusters[g], surface, place);
      model.arm.segment<3>(at) += rt * (place - before);
    }
    // bent planes know better than the step, whose forces are those of facets; but model and step are to rest alike.
    // Where a flat tool touches what is round, the step's places go from facet to facet, and what they lack would
    // swing.
    const double known = surface.flat_directions > 0 ? 0.0 : surface.bend.isZero(0.0) ? 1.0 : input.still;
    merged_.segment<3>(at) = known * model.contact_force.segment<3>(at);
    for (const auto& [index, weight] : clusters[g]) addLoads(points[static_cast<std::size_t>(index)], known);
    if (first.internal) {
      surface.kind = LiveSurface::Kind::internal;
      surface.normal = (rt * surface.normal).eval();
      surface.offset = surface.normal.dot(model.arm.segment<3>(at)) - first.gap;
    } else if (first.contact.second.body >= 0) {
      touched_[static_cast<std::size_t>(first.contact.second.body)].sums.push_back(std::move(partner));
    }
  }
  for (std::size_t k = 0; k < supports.size(); ++k) {
    const auto& [body, support] = supports[k];
    const std::size_t g = clusters.size() + k;
    const auto at = static_cast<Eigen::Index>(3 * g);
    LiveSurface& surface = model.surface[g];
    surface = {};
    surface.kind = LiveSurface::Kind::support;
    surface.normal = rt * support.normal;
    surface.load = support.load;
    model.friction[g] = support.friction;
    model.contact_force.segment<3>(at) = model.damped_force.segment<3>(at) = rt * support.force;
    columns_.close();  // nothing of the tool
    touched_[static_cast<std::size_t>(body)].sums.push_back({static_cast<int>(at), support.nodes});
    touched_[static_cast<std::size_t>(body)].supports.push_back(support);
  }
  model.supports = static_cast<int>(supports.size());
  model.bearing.setZero(model.supports, 3 * m);
}

// What contacts do to the tool and to the bodies that it touches.
void ToolReduction::addCompliance(World& world, const LiveSettings& settings, const Input& input, LiveBasis& basis,
                                  LiveModel& model) {
  const Body tool = world.tool();
  const Eigen::Index m = model.contacts, r = basis.modes.cols();
  model.shape = atContacts(basis.modes);
  // what the merged contacts' forces leave out of those that they stand for
  model.force += basis.modes.transpose() * loads_ - model.shape.transpose() * merged_;
  for (Eigen::Index i = 0; i < m; ++i) {
    model.torque -= Vec3(model.arm.segment<3>(3 * i)).cross(Vec3(merged_.segment<3>(3 * i)));
  }
  MatX w = e_ * MatX(gram_.selfadjointView<Eigen::Lower>());
  if (r > 0) {
    const MatX shape = model.shape;
    const VecX yields = (model.squared_frequency.array() + mass_scale_ / e_).inverse();
    w -= shape * yields.asDiagonal() * shape.transpose();
  }
  model.tool_compliance = w;
  model.partners_yield = false;
  MatX others = MatX::Zero(3 * m, 3 * m);
  addPartners(world, settings, input, basis, model, others);
  if (model.partners_yield) {
    const Mat3 rotation = tool.state.handle.pose.matrix(), rt = rotation.transpose();
    for (Eigen::Index i = 0; i < m; ++i) {
      for (Eigen::Index j = 0; j < m; ++j) {
        w.block<3, 3>(3 * i, 3 * j) += rt * others.block<3, 3>(3 * i, 3 * j) * rotation;
      }
    }
  }
  model.compliance = 0.5 * (w + w.transpose());
  // It has no negative eigenvalue but by rounding: the modes are Ritz vectors, whose share is at most the whole.
  for (double shift = kLeastCompliance; m > 0; shift *= 10) {
    model.compliance.diagonal().array() += shift;
    if (shift > kMostShift || isPositiveDefinite(MatX(model.compliance))) break;
  }
}

// J times a field on the free nodes, by columns.
MatX ToolReduction::atContacts(const MatX& field) const {
  MatX out = MatX::Zero(3 * columns_.size(), field.cols());
  if (out.size() == 0) return out;
  for (int c = 0; c < columns_.size(); ++c) {
    for (int k = columns_.begin[c]; k < columns_.begin[c + 1]; ++k) {
      out.middleRows<3>(3 * c) += columns_.block[k].transpose() * field.middleRows<3>(3 * columns_.node[k]);
    }
  }
  return out;
}

// Second differences of the elastic forces along pairs of modes, free rows; handle's frame.
const MatX& ToolReduction::secondDifferences(const BodyModel& tool, const LiveBasis& basis, int count) {
  constexpr double kAmplitude = 3e-4;  // [m], of the node that a mode moves most
  const ElasticMesh& fem = tool.elasticity();
  // f(y + d) + f(y - d) - 2 f(y) of the free rows
  const auto bend = [&](const VecX& d) {
    ElasticAhead ahead;
    VecX sum = VecX::Zero(d.size());
    for (const double sign : {1.0, -1.0}) {
      VecX x = positions_;
      for (int i = 0; i < tool.freeNodes(); ++i) x.segment<3>(3 * tool.free()[i]) += sign * d.segment<3>(3 * i);
      fem.energyAt(x, elastic_, ahead);
      for (int i = 0; i < tool.freeNodes(); ++i) {
        const Eigen::Index node = 3 * tool.free()[i];
        sum.segment<3>(3 * i) += ahead.forces.segment<3>(node) - forces_.segment<3>(node);
      }
    }
    return sum;
  };
  std::vector<VecX> way;
  std::vector<std::pair<int, int>> pairs;
  std::vector<double> scale;
  for (int i = 0; i < count; ++i) {
    scale.push_back(kAmplitude / basis.modes.col(i).cwiseAbs().maxCoeff());
    way.push_back(scale.back() * basis.modes.col(i));
    for (int j = i; j < count; ++j) pairs.emplace_back(i, j);
  }
  MatX& out = second_;
  out.resize(basis.modes.rows(), static_cast<Eigen::Index>(pairs.size()));
  parallelFor(static_cast<int>(pairs.size()), [&](int c) {
    const auto [i, j] = pairs[static_cast<std::size_t>(c)];
    out.col(c) = bend(i == j ? way[i] : VecX(way[i] + way[j]));
  });
  std::vector<VecX> own;
  for (std::size_t c = 0; c < pairs.size(); ++c) {
    if (pairs[c].first == pairs[c].second) own.push_back(out.col(static_cast<Eigen::Index>(c)));
  }
  for (std::size_t c = 0; c < pairs.size(); ++c) {
    const auto [i, j] = pairs[c];
    auto column = out.col(static_cast<Eigen::Index>(c));
    if (i != j) column = 0.5 * (column - own[i] - own[j]).eval();
    column /= scale[i] * scale[j];
  }
  return out;
}

void ToolReduction::addCurvature(const World& world, const LiveBasis& basis, LiveModel& model) {
  if (model.second == 0) {
    model.curvature.resize(3 * model.contacts, 0);
    return;
  }
  const MatX& forces = touches_ ? second_ : secondDifferences(world.tool().model, basis, model.second);
  MatX response = forces;
  factor_->solve(response);
  response *= e_;
  const MatX modal = basis.modes.transpose() * forces;
  for (int k = 0; k < basis.modes.cols(); ++k) {
    response -= basis.modes.col(k) * (modal.row(k) / (model.squared_frequency[k] + mass_scale_ / e_));
  }
  model.curvature = atContacts(response);
}

void ToolReduction::findTurning(const BodyModel& tool, const LiveBasis& basis) {
  const ScopedTimer timer(times_.modes);
  turning_ = tool.elasticity().turningStiffness(positions_, elastic_, tool.row(), basis.modes);
}

// What an applied force adds to the stiffness of those modes that have a second order is in that already: it works on
// their way. A stiffness below zero would grow without end, as the model does not know what it grows into: it is none.
void ToolReduction::addTurning(const LiveBasis& basis, LiveModel& model) const {
  MatX turning = turning_;
  const Eigen::Index r = basis.modes.cols();
  if (r == 0) return model.turning.resize(0, 0);
  for (int i = 0, c = 0; i < model.second; ++i) {
    for (int j = i; j < model.second; ++j, ++c) {
      turning(j, i) += model.contact_force.dot(model.curvature.col(c));
      turning(i, j) = turning(j, i);
    }
  }
  const VecX known = model.squared_frequency.head(r);
  MatX whole = turning;
  whole.diagonal() += known;
  if (!isPositiveDefinite(whole)) {
    const SymmetricEigen found = symmetricEigen(whole);
    turning = found.vectors * found.values.cwiseMax(0.0).asDiagonal() * found.vectors.transpose();
    turning.diagonal() -= known;
  }
  model.turning = turning;
}

LiveModel ToolReduction::reduce(World& world, const LiveSettings& settings, const Input& input, LiveBasis& basis) {
  const Body tool = world.tool();
  const Material& material = tool.model.elasticity().material();
  times_ = {};
  LiveModel model;
  model.pose = tool.state.handle.pose;
  model.twist = tool.state.handle.twist;
  model.alpha = material.damping_alpha;
  model.beta = material.damping_beta;
  const FrictionCone& cone = world.contact.cone;
  model.facets = cone.exact || cone.facets > LiveModel::kFacets ? 0 : cone.facets;
  positions_ = allPlaces(tool, input.shape);
  beginPartners(world, input.partners);
  Milestone factored;
  Aside placing([&] {
    placeContacts(world, settings, input, model);  // surfaces know nothing of the tool's system
    if (!factored.await()) return;
    gram_.setZero(3 * model.contacts, 3 * model.contacts);
    if (model.contacts > 0 && tool.model.freeNodes() > 0) factor_->gram(columns_, gram_);
    for (PartnerReduction& p : begun_) {
      const std::vector<NodeSum>& sums = touched_[static_cast<std::size_t>(p.body())].sums;
      if (!sums.empty()) p.touch(sums);
    }
  });
  const bool ready = factored.reachBy([&] { return factorize(world, settings, input, model); });
  if (ready) {
    findToolModes(input, settings.modes, basis, model);
    addInertia(world, input, basis, model);
    findTurning(tool.model, basis);
    model.second =
        std::max(0, std::min({settings.second_order, LiveSize::kSecond, static_cast<int>(basis.modes.cols())}));
    if (touches_ && model.second > 0) secondDifferences(tool.model, basis, model.second);
    // those of what it touched are asked for now or by the next step
    for (const PartnerBasis& p : input.partners)
      forcesOfPartner(world, p.body, correctionOf(input.corrections, p.body));
    holdPartners(settings, input.partners);
  }
  placing.wait();
  if (!ready) {
    model.mass = std::numeric_limits<double>::quiet_NaN();
    return model;
  }
  if (model.contacts == 0) model.second = 0;
  addCompliance(world, settings, input, basis, model);
  begun_.clear();  // what it knows of the world does not outlive a step
  addCurvature(world, basis, model);
  addTurning(basis, model);
  touches_ = model.contacts > 0;
  return model;
}

void dampForces(const World& world, double h, DampedForces& damped) {
  const Body tool = world.tool();
  const Mat3 rt = tool.state.handle.pose.matrix().transpose();
  const double share = h / (tool.model.elasticity().material().damping_beta + h);
  DampedForces next;  // of each track all of now, then damped
  const ContactMemory& memory = world.state().contacts;
  for (std::size_t k = 0; k < memory.loaded.size(); ++k) {
    const Contact& c = memory.loaded[k];
    const bool first = c.first.body == world.toolIndex();
    if (!first && c.second.body != world.toolIndex()) continue;
    const Vec3 force = memory.loadedForce(k);
    const auto same = std::find_if(next.begin(), next.end(), [&](const auto& d) { return d.first == c.track; });
    Vec3& sum = same != next.end() ? same->second : next.emplace_back(c.track, Vec3::Zero()).second;
    sum += rt * (first ? force : Vec3(-force));
  }
  for (auto& [track, force] : next) {
    const std::uint64_t wanted = track;
    const auto before = std::find_if(damped.begin(), damped.end(), [&](const auto& d) { return d.first == wanted; });
    const Vec3 old = before == damped.end() ? Vec3(Vec3::Zero()) : before->second;
    force = old + share * (force - old);
  }
  damped = std::move(next);
}

}  // namespace palpate
