#include "palpate/contact/contact.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>
#include <utility>

#include "palpate/contact/feature_pair.h"

namespace palpate {
namespace {

// Finalizer of splitmix64: a bijection that spreads every bit.
std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

std::uint64_t nodeKey(int body, int node) {
  return (static_cast<std::uint64_t>(body) << 32) | static_cast<std::uint32_t>(node);
}

constexpr double kSameFacing = 0.7;  // cosine; a patch's points that face elsewhere bound other motions

}  // namespace

std::uint64_t contactKey(std::uint64_t a, std::uint64_t b, std::uint64_t c, std::uint64_t d) {
  return mix(mix(mix(mix(a) ^ b) ^ c) ^ d);
}

void setTangents(Contact& contact) {
  const Vec3 axis = std::abs(contact.normal.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY();
  contact.tangent1 = (axis - contact.normal.dot(axis) * contact.normal).normalized();
  contact.tangent2 = contact.normal.cross(contact.tangent1);
}

Contact turnedAround(Contact contact) {
  std::swap(contact.first, contact.second);
  contact.normal = -contact.normal;
  ContactFeatures& f = contact.features;
  if (f.first < 0) return contact;
  std::swap(f.first_surface, f.second_surface);
  std::swap(f.first, f.second);
  switch (static_cast<FeaturePair::Kind>(f.kind)) {
    case FeaturePair::Kind::vertex_face:
      f.kind = static_cast<int>(FeaturePair::Kind::face_vertex);
      break;
    case FeaturePair::Kind::face_vertex:
      f.kind = static_cast<int>(FeaturePair::Kind::vertex_face);
      break;
    case FeaturePair::Kind::edge_edge:
      break;
  }
  return contact;
}

// Proposes up to three points that span the patch order_[begin, end): the deepest, the one farthest from it, the one
// farthest from the line of both.
void ContactReduction::extremePoints(const std::vector<Contact>& all, std::size_t begin, std::size_t end) {
  const auto first = order_.begin() + static_cast<std::ptrdiff_t>(begin);
  const auto last = order_.begin() + static_cast<std::ptrdiff_t>(end);
  const int deepest = *std::min_element(first, last, [&](int a, int b) {
    return all[a].end_gap != all[b].end_gap ? all[a].end_gap < all[b].end_gap : a < b;
  });
  proposals_.push_back(deepest);
  if (end - begin == 1) return;
  const auto farthest = [&](auto distance) {
    int best = *first;
    double value = -1;
    for (auto i = first; i != last; ++i) {
      const double d = distance(all[*i].position);
      if (d > value) {
        value = d;
        best = *i;
      }
    }
    return best;
  };
  const Vec3 origin = all[deepest].position;
  const int second = farthest([&](const Vec3& p) { return (p - origin).squaredNorm(); });
  if (second == deepest) return;
  proposals_.push_back(second);
  if (end - begin == 2) return;
  const Vec3 along = (all[second].position - origin).normalized();
  const int third = farthest([&](const Vec3& p) { return (p - origin).cross(along).squaredNorm(); });
  if (third != deepest && third != second) proposals_.push_back(third);
}

// Patch by patch: those in `kept`, and points that span the patch; pairs of surfaces are numbered on the way.
void ContactReduction::propose(const std::vector<Contact>& all, const std::vector<std::uint64_t>& kept) {
  order_.resize(all.size());
  std::iota(order_.begin(), order_.end(), 0);
  std::sort(order_.begin(), order_.end(), [&](int a, int b) {
    const Contact& p = all[a];
    const Contact& q = all[b];
    return std::tuple(p.first.body, p.partner, p.patch, a) < std::tuple(q.first.body, q.partner, q.patch, b);
  });
  proposals_.clear();
  kept_.assign(all.size(), 0);
  pair_.resize(all.size());
  pairs_ = 0;
  for (std::size_t begin = 0, end = 0; begin < order_.size(); begin = end) {
    const Contact& head = all[order_[begin]];
    if (begin == 0 || !samePair(head, all[order_[begin - 1]])) ++pairs_;
    for (; end < order_.size() && samePatch(head, all[order_[end]]); ++end) {
      const int c = order_[end];
      pair_[c] = pairs_ - 1;
      if (!std::binary_search(kept.begin(), kept.end(), all[c].track)) continue;
      kept_[c] = 1;
      proposals_.push_back(c);
    }
    proposeByFacing(all, begin, end);
  }
}

// Extreme points of the patch order_[begin, end), of each side that it faces, the deepest one's side first.
void ContactReduction::proposeByFacing(const std::vector<Contact>& all, std::size_t begin, std::size_t end) {
  const auto last = order_.begin() + static_cast<std::ptrdiff_t>(end);
  while (begin < end) {
    const auto first = order_.begin() + static_cast<std::ptrdiff_t>(begin);
    const int deepest = *std::min_element(first, last, [&](int a, int b) { return all[a].end_gap < all[b].end_gap; });
    const Vec3 facing = all[deepest].normal;
    const auto middle = std::partition(first, last, [&](int a) { return all[a].normal.dot(facing) > kSameFacing; });
    const auto split = std::max(static_cast<std::size_t>(middle - order_.begin()), begin + 1);
    extremePoints(all, begin, split);
    begin = split;
  }
}

// The heaviest free node of the contact's soft bodies is its own from now on. @returns false if none has weight enough;
// true without soft bodies
bool ContactReduction::takeNode(const Contact& contact, const std::vector<char>& soft) {
  constexpr double kLeastShare = 0.4;  // of the heaviest node's weight
  const auto isSoft = [&](const ContactPoint& p) {
    return p.body >= 0 && p.body < static_cast<int>(soft.size()) && soft[p.body];
  };
  double heaviest = 0;
  for (const ContactPoint* point : {&contact.first, &contact.second}) {
    if (!isSoft(*point)) continue;
    for (int k = 0; k < point->count; ++k) heaviest = std::max(heaviest, point->weight[k]);
  }
  if (heaviest == 0) return true;
  Taken best{-1, -1, contact.normal};
  double most = kLeastShare * heaviest;
  for (const ContactPoint* point : {&contact.first, &contact.second}) {
    if (!isSoft(*point)) continue;
    for (int k = 0; k < point->count; ++k) {
      if (point->weight[k] <= most) continue;
      const auto [first, last] = nodes_.equal_range(nodeKey(point->body, point->node[k]));
      if (std::any_of(first, last, [&](const auto& t) { return t.second.normal.dot(contact.normal) > kSameFacing; })) {
        continue;
      }
      most = point->weight[k];
      best.body = point->body;
      best.node = point->node[k];
    }
  }
  if (best.body >= 0) nodes_.emplace(nodeKey(best.body, best.node), best);
  return best.body >= 0;
}

// Takes proposals, kept ones first and then the deepest, unless one of the same pair of surfaces that is taken already
// lies nearer than `spacing` and faces the same way, or no node is left for it; those that were kept are all taken, or
// what rests on them would sink and be lifted in turn.
void ContactReduction::takeSpaced(const std::vector<Contact>& all, double spacing, const std::vector<char>& soft) {
  std::sort(proposals_.begin(), proposals_.end(), [&](int a, int b) {
    if (kept_[a] != kept_[b]) return kept_[a] > kept_[b];
    if (all[a].end_gap != all[b].end_gap) return all[a].end_gap < all[b].end_gap;
    return std::tuple(all[a].key, a) < std::tuple(all[b].key, b);
  });
  chosen_.clear();
  taken_.assign(all.size(), 0);
  nodes_.clear();
  latest_.assign(static_cast<std::size_t>(pairs_), -1);
  earlier_.assign(all.size(), -1);
  for (const int i : proposals_) {
    const Contact& c = all[i];
    int& latest = latest_[pair_[i]];
    bool crowded = taken_[i] != 0;
    for (int j = kept_[i] ? -1 : latest; j >= 0 && !crowded; j = earlier_[j]) {
      const Contact& o = all[j];
      crowded = o.normal.dot(c.normal) > kSameFacing && (c.position - o.position).squaredNorm() < spacing * spacing;
    }
    if (crowded || (!takeNode(c, soft) && !kept_[i])) continue;
    taken_[i] = 1;
    earlier_[i] = latest;
    latest = i;
    chosen_.push_back(i);
  }
}

const std::vector<int>& ContactReduction::choose(const std::vector<Contact>& candidates,
                                                 const std::vector<std::uint64_t>& kept, double spacing,
                                                 const std::vector<char>& soft) {
  propose(candidates, kept);
  takeSpaced(candidates, spacing, soft);
  return chosen_;
}

}  // namespace palpate
