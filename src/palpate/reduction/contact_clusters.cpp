#include "palpate/reduction/contact_clusters.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "palpate/math/largest_norm.h"
#include "palpate/reduction/farthest_first.h"

namespace palpate {
namespace {

constexpr double kFarthest = 0.03;  // that a surface is followed ahead [m]
constexpr double kSudden = 20.0;    // [m/s^2]: at which a hand may start

Contact turnedAround(Contact c) {
  std::swap(c.first, c.second);
  c.normal = -c.normal;
  return c;
}

bool alike(const TouchPoint& a, const TouchPoint& b) {
  if (a.tied || b.tied) return a.tied && b.tied && a.contact.second.body == b.contact.second.body;
  return a.contact.partner == b.contact.partner && a.internal == b.internal &&
         a.contact.normal.dot(b.contact.normal) > kAlike;
}

double pressure(const TouchPoint& p) { return std::max(0.0, p.contact.normal.dot(p.force)); }

// The tool's joints.
void takeTied(const World& world, const VecX& positions, std::vector<TouchPoint>& out) {
  const int tool = world.toolIndex();
  for (const Contact& c : world.glued(tool)) {
    TouchPoint p;
    const bool second = c.first.body != tool;
    p.contact = second ? turnedAround(c) : c;
    p.tied = true;
    p.place = p.contact.first.at(positions);
    const ContactMemory::Force* force = world.state().contacts.find(c.track);
    if (force != nullptr) p.force = second ? Vec3(-force->force) : force->force;
    out.push_back(p);
  }
}

// What is near: thousands where a large tool lies on a plane, so that most are neither read as a whole nor sorted.
struct Near {
  double gap;
  std::uint64_t key, track;
  bool plane;         // of the planes, or of the others
  std::size_t which;  // of them
  Vec3 force;         // of the last step [N]
};

bool nearer(const Near& a, const Near& b) { return std::pair(a.gap, a.key) < std::pair(b.gap, b.key); }
bool farther(const Near& a, const Near& b) { return nearer(b, a); }

// What is near and what is left of it.
struct Sorted {
  std::vector<Near> near;  // by gap: within some reach, and what carries force
  std::vector<Near> left;  // a heap, the nearest on top
};

// The forces of the last step on what is near: that of the same features, or of the nearest ones that it may have moved
// on to. What carries force and is not near is appended, as touching.
Sorted sortNear(const World& world, double reach, NearContacts& found) {
  const ContactMemory& memory = world.state().contacts;
  std::vector<std::size_t> loaded;
  std::vector<std::uint64_t> keys, tracks;
  for (std::size_t k = 0; k < memory.loaded.size(); ++k) {
    const Contact& c = memory.loaded[k];
    if (c.glued() || (c.first.body != world.toolIndex() && c.second.body != world.toolIndex())) continue;
    loaded.push_back(k);
    keys.push_back(c.key);
    tracks.push_back(c.track);
  }
  std::sort(keys.begin(), keys.end());
  std::sort(tracks.begin(), tracks.end());
  const auto among = [](const std::vector<std::uint64_t>& all, std::uint64_t one) {
    return std::binary_search(all.begin(), all.end(), one);
  };
  Sorted out;
  std::vector<Near> alike;  // of the features or on the way of something that carries force
  const auto sort = [&](const Near& n) {
    const bool same = !loaded.empty() && (among(tracks, n.track) || among(keys, n.key));
    (same ? alike : n.gap < reach ? out.near : out.left).push_back(n);
  };
  for (std::size_t k = 0; k < found.planes.size(); ++k) {
    const VertexNearPlane& v = found.planes[k];
    sort({v.gap, v.key, v.key, true, k, Vec3::Zero()});
  }
  for (std::size_t k = 0; k < found.others.size(); ++k) {
    const Contact& c = found.others[k];
    sort({c.gap, c.key, c.track, false, k, Vec3::Zero()});
  }
  std::sort(alike.begin(), alike.end(), nearer);
  std::vector<char> given(alike.size(), 0);
  const auto give = [&](std::size_t k, auto same) {
    for (std::size_t i = 0; i < given.size(); ++i) {
      if (given[i] || !same(alike[i])) continue;
      given[i] = 1;
      alike[i].force = memory.loadedForce(k);
      return true;
    }
    return false;
  };
  std::vector<std::size_t> moved;
  for (const std::size_t k : loaded) {
    const std::uint64_t key = memory.loaded[k].key;
    if (!give(k, [&](const Near& n) { return n.key == key; })) moved.push_back(k);
  }
  std::vector<Near> away;
  for (const std::size_t k : moved) {
    const Contact& c = memory.loaded[k];
    if (give(k, [&](const Near& n) { return n.track == c.track; })) continue;
    away.push_back({0, c.key, c.track, false, found.others.size(), memory.loadedForce(k)});
    found.others.push_back(c);
    found.others.back().gap = 0;
  }
  for (std::size_t i = 0; i < alike.size(); ++i) {
    (given[i] || alike[i].gap < reach ? out.near : out.left).push_back(alike[i]);
  }
  std::sort(out.near.begin(), out.near.end(), nearer);
  out.near.insert(out.near.end(), away.begin(), away.end());
  std::make_heap(out.left.begin(), out.left.end(), farther);
  return out;
}

// Points from `first` on, in at most so many clusters; see clusterTouchPoints().
void appendClusters(const std::vector<TouchPoint>& points, int first, int end, int most,
                    std::vector<TouchCluster>& out) {
  const int n = end - first;
  if (n <= most) {
    for (int i = first; i < end; ++i) out.push_back({{i, 1.0}});
    return;
  }
  // the first seed carries the most force, or is nearest
  int seed = first;
  for (int i = first + 1; i < end; ++i) {
    const auto rank = [&](int k) { return std::pair(-pressure(points[k]), points[k].gap); };
    if (!points[i].tied && rank(i) < rank(seed)) seed = i;
  }
  const Groups groups = farthestFirst(n, seed - first, most, [&](int i, int j) {
    const TouchPoint &a = points[first + i], &b = points[first + j];
    return (a.place - b.place).norm() + (alike(a, b) ? 0.0 : kOtherGroup);
  });
  for (int g = 0; g < groups.count; ++g) {
    double sum = 0;
    int nearest = -1, count = 0;
    for (int i = first; i < end; ++i) {
      if (groups.owner[i - first] != g) continue;
      ++count;
      sum += pressure(points[i]);
      if (nearest < 0 || points[i].gap < points[nearest].gap) nearest = i;
    }
    if (nearest < 0) continue;
    TouchCluster cluster;
    for (int i = first; i < end; ++i) {
      if (groups.owner[i - first] != g) continue;
      if (points[i].tied) {
        cluster.emplace_back(i, 1.0 / count);
      } else if (sum > 0 && pressure(points[i]) > 0) {
        cluster.emplace_back(i, pressure(points[i]) / sum);
      }
    }
    if (cluster.empty()) cluster.emplace_back(nearest, 1.0);
    out.push_back(std::move(cluster));
  }
}

}  // namespace

std::vector<TouchPoint> findTouchPoints(World& world, const World::ToolMotion& motion, const TouchReach& reach,
                                        NearContacts& near) {
  const double margin = reach.margin, lookahead = reach.lookahead;
  const int tool = world.toolIndex();
  const VecX &positions = motion.positions, &speeds = motion.speeds;
  const double own = largestNorm(speeds);
  double others = 0;
  for (int b = 0; b < world.bodies(); ++b) {
    if (b != tool) others = std::max(others, largestNorm(world.body(b).state.velocities));
  }
  const double fastest = std::max(own, others);
  const double ahead = lookahead * fastest > kFarthest ? kFarthest / fastest : lookahead;
  const double sudden = 0.5 * kSudden * lookahead * lookahead;
  near.planes.clear();
  near.others.clear();
  world.nearPlanes(motion, margin + lookahead * fastest + sudden, near.planes);
  world.nearSurfaces(motion, ahead, near.others);
  // farther away than that, nothing closes in time that goes on as it moves
  const double closes = 1.001 * (margin + lookahead * (own + fastest));
  Sorted sorted = sortNear(world, closes, near);
  const auto speedsOf = [&](int body) -> const VecX& {
    return body == tool ? speeds : world.body(body).state.velocities;
  };
  const VecX correction = positions - world.body(tool).state.positions;
  // what only a sudden start would bring near, as far as there is room: nothing is merged for it
  const auto room = static_cast<std::size_t>(std::max(0, reach.most));
  std::vector<TouchPoint> out, later;
  takeTied(world, positions, out);
  const auto takeContact = [&](const Contact& found, const Vec3& force) {
    if (found.first.body != tool && found.second.body != tool) return;
    const bool second = found.first.body != tool;
    const ContactPoint &mine = second ? found.second : found.first, &other = second ? found.first : found.second;
    const Vec3 normal = second ? Vec3(-found.normal) : found.normal;
    const bool internal = other.body == tool;
    double gap = found.gap;
    Vec3 closing = mine.at(speeds);
    if (other.body >= 0) closing -= other.at(speedsOf(other.body));
    // what carries nothing although it is nearer than contact keeps apart, the step lets be: only a correction counts
    if (force.isZero(0.0)) {
      Vec3 way = mine.at(correction);
      if (internal) way -= other.at(correction);
      gap -= std::min(0.0, gap - normal.dot(way));
    }
    const double then = gap + lookahead * std::min(0.0, normal.dot(closing));
    const bool soon = then < margin || !force.isZero(0.0);
    if (!soon && !(then < margin + sudden && later.size() < room)) return;
    TouchPoint& p = soon ? out.emplace_back() : later.emplace_back();
    p.contact = second ? turnedAround(found) : found;
    p.internal = internal;
    p.gap = gap;
    p.place = mine.at(positions);
    p.force = second ? Vec3(-force) : force;
  };
  const auto take = [&](const Near& n) {
    if (n.plane) {
      takeContact(world.planeContact(motion, near.planes[n.which]), n.force);
    } else {
      takeContact(near.others[n.which], n.force);
    }
  };
  out.reserve(out.size() + sorted.near.size());
  for (const Near& n : sorted.near) take(n);
  std::vector<Near>& left = sorted.left;
  for (auto end = left.end(); end != left.begin() && out.size() + later.size() < room;) {
    std::pop_heap(left.begin(), end, farther);
    --end;
    take(*end);
  }
  for (std::size_t k = 0; k < later.size() && out.size() < room; ++k) out.push_back(later[k]);
  return out;
}

std::vector<TouchCluster> clusterTouchPoints(const std::vector<TouchPoint>& points, int most) {
  const int n = static_cast<int>(points.size());
  int tied = 0;
  while (tied < n && points[tied].tied) ++tied;
  std::vector<TouchCluster> out;
  appendClusters(points, 0, tied, std::min(most, kTiedClusters), out);
  appendClusters(points, tied, n, most - static_cast<int>(out.size()), out);
  return out;
}

}  // namespace palpate
