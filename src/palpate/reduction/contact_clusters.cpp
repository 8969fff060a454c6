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
  std::uint64_t key;
  int which;        // of the planes, or of the others
  bool plane;       // of the planes
  int loaded = -1;  // whose force it has, of the last step's; -1: none
};

bool nearer(const Near& a, const Near& b) { return std::pair(a.gap, a.key) < std::pair(b.gap, b.key); }
bool farther(const Near& a, const Near& b) { return nearer(b, a); }

template <class F>
void forEachNear(const NearContacts& found, F&& f) {
  for (std::size_t k = 0; k < found.planes.size(); ++k) {
    f(Near{found.planes[k].gap, found.planes[k].key, static_cast<int>(k), true});
  }
  for (std::size_t k = 0; k < found.others.size(); ++k) {
    f(Near{found.others[k].gap, found.others[k].key, static_cast<int>(k), false});
  }
}

std::uint64_t trackOf(const NearContacts& found, const Near& n) {
  return n.plane ? n.key : found.others[static_cast<std::size_t>(n.which)].track;
}

// A few numbers that most of many others are not among.
class FewNumbers {
 public:
  void add(std::uint64_t one) {
    bits_ |= std::uint64_t{1} << (one & 63);
    all_.push_back(one);
  }
  void close() { std::sort(all_.begin(), all_.end()); }
  bool has(std::uint64_t one) const {
    return (bits_ >> (one & 63) & 1) != 0 && std::binary_search(all_.begin(), all_.end(), one);
  }

 private:
  std::uint64_t bits_ = 0;  // one that is among them has one of these
  std::vector<std::uint64_t> all_;
};

// The forces of the last step on what is near: that of the same features, or of the nearest ones that it may have moved
// on to. What carries force and is not near is appended, as what it is now.
// @param reach  within which all is wanted
// @returns by gap: what is within reach, and what carries force
std::vector<Near> sortNear(const World& world, double reach, NearContacts& found) {
  const ContactMemory& memory = world.state().contacts;
  std::vector<int> loaded;
  FewNumbers keys, tracks;
  for (std::size_t k = 0; k < memory.loaded.size(); ++k) {
    const Contact& c = memory.loaded[k];
    if (c.glued() || (c.first.body != world.toolIndex() && c.second.body != world.toolIndex())) continue;
    loaded.push_back(static_cast<int>(k));
    keys.add(c.key);
    tracks.add(c.track);
  }
  keys.close();
  tracks.close();
  std::vector<Near> out;
  std::vector<Near> alike;  // of the features or on the way of something that carries force
  forEachNear(found, [&](const Near& n) {
    if (keys.has(n.key) || tracks.has(trackOf(found, n))) {
      alike.push_back(n);
    } else if (n.gap < reach) {
      out.push_back(n);
    }
  });
  std::sort(alike.begin(), alike.end(), nearer);
  const auto give = [&](int k, auto same) {
    for (Near& n : alike) {
      if (n.loaded >= 0 || !same(n)) continue;
      n.loaded = k;
      return true;
    }
    return false;
  };
  std::vector<int> moved;
  for (const int k : loaded) {
    const std::uint64_t key = memory.loaded[static_cast<std::size_t>(k)].key;
    if (!give(k, [&](const Near& n) { return n.key == key; })) moved.push_back(k);
  }
  std::vector<Near> away;
  for (const int k : moved) {
    const Contact& c = memory.loaded[static_cast<std::size_t>(k)];
    if (give(k, [&](const Near& n) { return trackOf(found, n) == c.track; })) continue;
    away.push_back({0, c.key, static_cast<int>(found.others.size() + away.size()), false, k});
  }
  for (const Near& n : alike) {
    if (n.loaded >= 0 || n.gap < reach) out.push_back(n);
  }
  std::sort(out.begin(), out.end(), nearer);
  for (const Near& n : away) {
    found.others.push_back(memory.loaded[static_cast<std::size_t>(n.loaded)]);
    world.renew(found.others.back());
  }
  out.insert(out.end(), away.begin(), away.end());
  return out;
}

// What sortNear() left: a heap, the nearest on top.
std::vector<Near> leftOver(const NearContacts& found, const std::vector<Near>& sorted, double reach) {
  std::vector<Near> out;
  std::vector<std::pair<bool, int>> taken;  // beyond reach
  for (const Near& n : sorted) {
    if (n.loaded >= 0) taken.emplace_back(n.plane, n.which);
  }
  std::sort(taken.begin(), taken.end());
  forEachNear(found, [&](const Near& n) {
    if (n.gap >= reach && !std::binary_search(taken.begin(), taken.end(), std::pair(n.plane, n.which)))
      out.push_back(n);
  });
  std::make_heap(out.begin(), out.end(), farther);
  return out;
}

// What tells touch points apart, side by side in memory.
struct Seen {
  Vec3 place, normal;
  double pressure, gap;
  int partner, body;  // of the other side
  bool internal, tied;
};

bool alike(const Seen& a, const Seen& b) {
  if (a.tied || b.tied) return a.tied && b.tied && a.body == b.body;
  return a.partner == b.partner && a.internal == b.internal && a.normal.dot(b.normal) > kAlike;
}

// Points from `first` on, in at most so many clusters; see clusterTouchPoints().
void appendClusters(const std::vector<TouchPoint>& points, int first, int end, int most,
                    std::vector<TouchCluster>& out) {
  const int n = end - first;
  if (n <= most) {
    for (int i = first; i < end; ++i) out.push_back({{i, 1.0}});
    return;
  }
  std::vector<Seen> seen;
  seen.reserve(static_cast<std::size_t>(n));
  for (int i = first; i < end; ++i) {
    const TouchPoint& p = points[i];
    seen.push_back(
        {p.place, p.contact.normal, pressure(p), p.gap, p.contact.partner, p.contact.second.body, p.internal, p.tied});
  }
  // the first seed carries the most force, or is nearest
  int seed = 0;
  for (int i = 1; i < n; ++i) {
    const auto rank = [&](int k) { return std::pair(-seen[k].pressure, seen[k].gap); };
    if (!seen[i].tied && rank(i) < rank(seed)) seed = i;
  }
  const Groups groups = farthestFirst(n, seed, most, [&](int i, int j) {
    return (seen[i].place - seen[j].place).norm() + (alike(seen[i], seen[j]) ? 0.0 : kOtherGroup);
  });
  for (int g = 0; g < groups.count; ++g) {
    double sum = 0;
    int nearest = -1, count = 0;
    for (int i = 0; i < n; ++i) {
      if (groups.owner[i] != g) continue;
      ++count;
      sum += seen[i].pressure;
      if (nearest < 0 || seen[i].gap < seen[nearest].gap) nearest = i;
    }
    if (nearest < 0) continue;
    TouchCluster cluster;
    for (int i = 0; i < n; ++i) {
      if (groups.owner[i] != g) continue;
      if (seen[i].tied) {
        cluster.emplace_back(first + i, 1.0 / count);
      } else if (sum > 0 && seen[i].pressure > 0) {
        cluster.emplace_back(first + i, seen[i].pressure / sum);
      }
    }
    if (cluster.empty()) cluster.emplace_back(first + nearest, 1.0);
    out.push_back(std::move(cluster));
  }
}

}  // namespace

const std::vector<TouchPoint>& findTouchPoints(World& world, const World::ToolMotion& motion, const TouchReach& reach,
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
  const std::vector<Near> sorted = sortNear(world, closes, near);
  const auto speedsOf = [&](int body) -> const VecX& {
    return body == tool ? speeds : world.body(body).state.velocities;
  };
  const VecX correction = positions - world.body(tool).state.positions;
  // what only a sudden start would bring near, as far as there is room: nothing is merged for it
  const auto room = static_cast<std::size_t>(std::max(0, reach.most));
  std::vector<TouchPoint>& out = near.points;
  out.clear();
  std::vector<TouchPoint> later;
  takeTied(world, positions, out);
  const ContactMemory& memory = world.state().contacts;
  const auto take = [&](const Near& n) {
    const auto which = static_cast<std::size_t>(n.which);
    TouchPoint& p = out.emplace_back();
    if (n.plane) {
      p.contact = world.planeContact(motion, near.planes[which]);
    } else {
      p.contact = near.others[which];
    }
    if (n.loaded >= 0) p.force = memory.loadedForce(static_cast<std::size_t>(n.loaded));
    if (p.contact.first.body != tool && p.contact.second.body != tool) {
      out.pop_back();
      return;
    }
    if (p.contact.first.body != tool) {
      p.contact = turnedAround(p.contact);
      p.force = -p.force;
    }
    const ContactPoint &mine = p.contact.first, &other = p.contact.second;
    p.internal = other.body == tool;
    p.gap = p.contact.gap;
    p.place = mine.at(positions);
    Vec3 closing = mine.at(speeds);
    if (other.body >= 0) closing -= other.at(speedsOf(other.body));
    // what carries nothing although it is nearer than contact keeps apart, the step lets be: only a correction counts
    const bool loaded = !p.force.isZero(0.0);
    if (!loaded) {
      Vec3 way = mine.at(correction);
      if (p.internal) way -= other.at(correction);
      p.gap -= std::min(0.0, p.gap - p.contact.normal.dot(way));
    }
    const double then = p.gap + lookahead * std::min(0.0, p.contact.normal.dot(closing));
    if (then < margin || loaded) return;
    if (then < margin + sudden && later.size() < room) later.push_back(p);
    out.pop_back();
  };
  out.reserve(out.size() + sorted.size() + 1);
  for (const Near& n : sorted) take(n);
  if (out.size() + later.size() < room) {
    std::vector<Near> left = leftOver(near, sorted, closes);
    for (auto end = left.end(); end != left.begin() && out.size() + later.size() < room;) {
      std::pop_heap(left.begin(), end, farther);
      --end;
      take(*end);
    }
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
