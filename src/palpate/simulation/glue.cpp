#include "palpate/simulation/glue.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/contact/feature_distance.h"
#include "palpate/contact/overlap.h"

namespace palpate {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kOnFace = 1e-9;  // of a barycentric weight
constexpr double kHardly = 1e-6;  // a weight that does not count in a circle

[[noreturn]] void refuse(const BodyModel& body, const Attachment& attachment, const char* key,
                         const std::string& cause) {
  throw InputError(body.name() + ": attachment " + attachment.name, key, cause);
}

using Corners = std::array<Vec3, 4>;

Corners cornersOf(const TetrahedralMesh& mesh, std::size_t tetrahedron) {
  Corners out;
  for (std::size_t k = 0; k < 4; ++k) out[k] = mesh.nodes[static_cast<std::size_t>(mesh.tetrahedra[tetrahedron][k])];
  return out;
}

std::array<double, 4> weightsIn(const Corners& c, const Vec3& p) {
  Mat3 edges;
  edges << c[1] - c[0], c[2] - c[0], c[3] - c[0];
  const Vec3 w = edges.inverse() * (p - c[0]);
  return {1.0 - w.sum(), w[0], w[1], w[2]};
}

double boxDistance(const Corners& c, const Vec3& p) {
  const Vec3 low = c[0].cwiseMin(c[1]).cwiseMin(c[2]).cwiseMin(c[3]);
  const Vec3 high = c[0].cwiseMax(c[1]).cwiseMax(c[2]).cwiseMax(c[3]);
  return (low - p).cwiseMax(p - high).cwiseMax(0.0).norm();
}

// 0 inside.
double distance(const Corners& c, const Vec3& p) {
  const std::array<double, 4> w = weightsIn(c, p);
  if (*std::min_element(w.begin(), w.end()) >= -kOnFace) return 0;
  double least = kInfinity;
  for (std::size_t k = 0; k < 4; ++k) {
    least = std::min(least, closestOnTriangle(p, c[(k + 1) % 4], c[(k + 2) % 4], c[(k + 3) % 4]).distance);
  }
  return least;
}

/// The tetrahedron that is nearest to a point; of equals the lowest.
struct Nearest {
  std::size_t tetrahedron = 0;
  double distance = kInfinity;
  Nearest(const TetrahedralMesh& mesh, const Vec3& p) {
    for (std::size_t t = 0; t < mesh.tetrahedra.size() && distance > 0; ++t) {
      const Corners corners = cornersOf(mesh, t);
      if (boxDistance(corners, p) >= distance) continue;
      const double d = palpate::distance(corners, p);
      if (d >= distance) continue;
      distance = d;
      tetrahedron = t;
    }
  }
};

ContactPoint placeIn(const BodyModel& model, int index, std::size_t tetrahedron, const Vec3& p) {
  const TetrahedralMesh& mesh = model.mesh().mesh;
  std::array<double, 4> w = weightsIn(cornersOf(mesh, tetrahedron), p);
  double sum = 0;
  for (double& share : w) {
    if (std::abs(share) < kOnFace) share = 0;
    sum += share;
  }
  ContactPoint out;
  out.body = index;
  for (std::size_t k = 0; k < 4; ++k) {
    if (w[k] != 0) out.add(mesh.tetrahedra[tetrahedron][k], w[k] / sum);
  }
  return out;
}

// How far a point is from a rigid body, 0 inside.
class RigidDistance {
 public:
  explicit RigidDistance(const BodyModel& model) : surface_(model.mesh().surface) { surface_.refit(); }
  double operator()(const Vec3& p) const { return inside(surface_, p) ? 0.0 : closestPoint(surface_, p).distance; }

 private:
  CollisionSurface surface_;
};

void requireNear(const BodyModel& own, const Attachment& attachment, const BodyModel& other, const Vec3& p,
                 double distance, double allowed) {
  if (distance <= allowed) return;
  refuse(own, attachment, "region",
         fmt::format(
             "holds a node at ({:.3g}, {:.3g}, {:.3g}) m, in the world, that is {:.2g} m from {}; it may be a mean "
             "edge from it, {:.2g} m",
             p.x(), p.y(), p.z(), distance, other.name(), allowed));
}

using Node = std::pair<int, int>;  // body, node

}  // namespace

Joint joinBodies(const std::vector<const BodyModel*>& models, int body, int attachment, int partner) {
  const BodyModel& own = *models[static_cast<std::size_t>(body)];
  const BodyModel& other = *models[static_cast<std::size_t>(partner)];
  const Attachment& glued = own.attachments()[static_cast<std::size_t>(attachment)];
  if (body == partner) refuse(own, glued, "to", "glues the body to itself");
  Joint out{body, attachment, partner, {}};
  const std::vector<Vec3>& nodes = own.mesh().mesh.nodes;
  double allowed = own.contactFinder().edgeLength();
  if (other.isRigid()) {
    const RigidDistance distance(other);
    for (const int n : glued.nodes) {
      requireNear(own, glued, other, nodes[static_cast<std::size_t>(n)], distance(nodes[static_cast<std::size_t>(n)]),
                  allowed);
      out.places.push_back(placeIn(other, partner, 0, nodes[static_cast<std::size_t>(n)]));
    }
    return out;
  }
  allowed = std::max(allowed, other.contactFinder().edgeLength());
  for (const int n : glued.nodes) {
    const Vec3& p = nodes[static_cast<std::size_t>(n)];
    const Nearest nearest(other.mesh().mesh, p);
    requireNear(own, glued, other, p, nearest.distance, allowed);
    out.places.push_back(placeIn(other, partner, nearest.tetrahedron, p));
  }
  return out;
}

// Each node that is glued must be free of what it is glued to, or its rows and theirs say the same.
void refuseCircles(const std::vector<const BodyModel*>& models, const std::vector<Joint>& joints) {
  std::map<Node, std::pair<const Joint*, std::size_t>> glued;
  for (const Joint& joint : joints) {
    const std::vector<int>& nodes =
        models[static_cast<std::size_t>(joint.body)]->attachments()[static_cast<std::size_t>(joint.attachment)].nodes;
    for (std::size_t k = 0; k < nodes.size(); ++k) glued[{joint.body, nodes[k]}] = {&joint, k};
  }
  std::map<Node, bool> known;  // false: the way from it is being followed
  std::vector<std::pair<Node, int>> way;
  for (const auto& [start, unused] : glued) {
    if (known.contains(start)) continue;
    way = {{start, 0}};
    known[start] = false;
    while (!way.empty()) {
      auto& [node, next] = way.back();
      const auto& [joint, place] = glued.at(node);
      const ContactPoint& point = joint->places[place];
      if (next == point.count) {
        known[node] = true;
        way.pop_back();
        continue;
      }
      const auto k = static_cast<std::size_t>(next++);
      const Node to{point.body, point.node[k]};
      if (std::abs(point.weight[k]) < kHardly || !glued.contains(to)) continue;
      const auto [at, fresh] = known.emplace(to, false);
      if (!fresh && !at->second) {
        const BodyModel& own = *models[static_cast<std::size_t>(joint->body)];
        refuse(own, own.attachments()[static_cast<std::size_t>(joint->attachment)], "to",
               "glues nodes to nodes of " + models[static_cast<std::size_t>(joint->partner)]->name() +
                   " that are glued to them: one of the two is enough");
      }
      if (fresh) way.push_back({to, 0});
    }
  }
}

void glueContacts(const std::vector<const BodyModel*>& models, const std::vector<Joint>& joints,
                  const std::vector<BodyState>& states, const std::vector<char>& moves, std::vector<Contact>& out) {
  constexpr std::uint64_t kKind = 0x676c7565;  // apart from the keys of all other contacts
  for (const Joint& joint : joints) {
    const auto body = static_cast<std::size_t>(joint.body), partner = static_cast<std::size_t>(joint.partner);
    if (!moves[body]) continue;
    const std::vector<int>& nodes = models[body]->attachments()[static_cast<std::size_t>(joint.attachment)].nodes;
    for (std::size_t k = 0; k < nodes.size(); ++k) {
      Contact c;
      c.partner = Contact::kGlue;
      c.first.body = joint.body;
      c.first.add(nodes[k], 1.0);
      c.second = joint.places[k];
      c.normal = Vec3::UnitX();
      c.tangent1 = Vec3::UnitY();
      c.tangent2 = Vec3::UnitZ();
      c.position = c.first.at(states[body].positions);
      const Vec3 gap = c.position - c.second.at(states[partner].positions);
      c.gap = gap.x();
      c.tangent_gap = {gap.y(), gap.z()};
      c.key = c.track = contactKey(kKind, body, static_cast<std::uint64_t>(nodes[k]));
      c.patch = c.key;
      out.push_back(c);
    }
  }
}

std::vector<char> surfaceAround(const BodyModel& body, const Attachment& attachment) {
  const SimulationMesh& mesh = body.mesh();
  std::vector<char> held(mesh.mesh.nodes.size(), 0), out;
  for (const int n : attachment.nodes) held[static_cast<std::size_t>(n)] = 1;
  for (const EmbeddedPoint& p : mesh.embedding) {
    const auto& t = mesh.mesh.tetrahedra[static_cast<std::size_t>(p.tetrahedron)];
    out.push_back(std::any_of(t.begin(), t.end(), [&](int n) { return held[static_cast<std::size_t>(n)] != 0; }) ? 1
                                                                                                                 : 0);
  }
  return out;
}

}  // namespace palpate
