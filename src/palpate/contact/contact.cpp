#include "palpate/contact/contact.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

namespace palpate {
namespace {

// Finalizer of splitmix64: a bijection that spreads every bit.
std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
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

const std::vector<int>& ContactReduction::choose(const std::vector<Contact>& candidates,
                                                 const std::vector<std::uint64_t>& kept, double spacing) {
  order_.resize(candidates.size());
  std::iota(order_.begin(), order_.end(), 0);
  std::sort(order_.begin(), order_.end(), [&](int a, int b) {
    const Contact& p = candidates[a];
    const Contact& q = candidates[b];
    return std::tuple(p.first.body, p.partner, p.patch, a) < std::tuple(q.first.body, q.partner, q.patch, b);
  });
  proposals_.clear();
  chosen_.clear();
  kept_.assign(candidates.size(), 0);
  pair_.resize(candidates.size());
  latest_.clear();
  earlier_.assign(candidates.size(), -1);
  for (std::size_t i = 0; i < order_.size();) {
    const Contact& head = candidates[order_[i]];
    const bool other_pair = i == 0 || head.first.body != candidates[order_[i - 1]].first.body ||
                            head.partner != candidates[order_[i - 1]].partner;
    if (other_pair) latest_.push_back(-1);
    std::size_t end = i;
    while (end < order_.size() && samePatch(candidates[order_[i]], candidates[order_[end]])) {
      const int c = order_[end++];
      pair_[c] = static_cast<int>(latest_.size()) - 1;
      if (!std::binary_search(kept.begin(), kept.end(), candidates[c].track)) continue;
      kept_[c] = 1;
      proposals_.push_back(c);
    }
    // by facing: the deepest one's side first
    while (i < end) {
      const int deepest = *std::min_element(
          order_.begin() + static_cast<std::ptrdiff_t>(i), order_.begin() + static_cast<std::ptrdiff_t>(end),
          [&](int a, int b) { return candidates[a].end_gap < candidates[b].end_gap; });
      const Vec3 facing = candidates[deepest].normal;
      const auto middle = std::partition(order_.begin() + static_cast<std::ptrdiff_t>(i),
                                         order_.begin() + static_cast<std::ptrdiff_t>(end),
                                         [&](int a) { return candidates[a].normal.dot(facing) > kSameFacing; });
      const auto split = std::max(static_cast<std::size_t>(middle - order_.begin()), i + 1);
      extremePoints(candidates, i, split);
      i = split;
    }
  }
  std::sort(proposals_.begin(), proposals_.end(), [&](int a, int b) {
    if (kept_[a] != kept_[b]) return kept_[a] > kept_[b];
    if (candidates[a].end_gap != candidates[b].end_gap) return candidates[a].end_gap < candidates[b].end_gap;
    return std::tuple(candidates[a].key, a) < std::tuple(candidates[b].key, b);
  });
  taken_.assign(candidates.size(), 0);
  for (const int i : proposals_) {
    const Contact& c = candidates[i];
    int& latest = latest_[pair_[i]];
    bool crowded = taken_[i] != 0;
    for (int j = kept_[i] ? -1 : latest; j >= 0 && !crowded; j = earlier_[j]) {
      const Contact& o = candidates[j];
      crowded = o.normal.dot(c.normal) > kSameFacing && (c.position - o.position).squaredNorm() < spacing * spacing;
    }
    if (crowded) continue;
    taken_[i] = 1;
    earlier_[i] = latest;
    latest = i;
    chosen_.push_back(i);
  }
  return chosen_;
}

}  // namespace palpate
