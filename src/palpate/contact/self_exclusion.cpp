#include "palpate/contact/self_exclusion.h"

#include <algorithm>

#include "palpate/common/error.h"

namespace palpate {
namespace {

void sortUnique(std::vector<int>& v) {
  std::sort(v.begin(), v.end());
  v.erase(std::unique(v.begin(), v.end()), v.end());
}

}  // namespace

SelfExclusion::SelfExclusion(const CollisionSurface& surface, std::vector<int> group, std::vector<int> offset,
                             std::vector<int> neighbor)
    : group_(std::move(group)), offset_(std::move(offset)), neighbor_(std::move(neighbor)) {
  const auto check = [](bool good, const char* what) {
    if (!good) throw InputError("self exclusion", "", what);
  };
  check(group_.size() == surface.rest().size(), "needs a group for each vertex");
  check(!offset_.empty() && offset_.front() == 0 && std::is_sorted(offset_.begin(), offset_.end()) &&
            static_cast<size_t>(offset_.back()) == neighbor_.size(),
        "offsets do not fit the neighbors");
  const int groups = static_cast<int>(offset_.size()) - 1;
  for (const int g : group_) check(g >= -1 && g < groups, "a vertex is in a group that does not exist");
  for (int g = 0; g < groups; ++g)
    check(std::is_sorted(neighbor_.begin() + offset_[static_cast<size_t>(g)],
                         neighbor_.begin() + offset_[static_cast<size_t>(g) + 1]),
          "neighbors are not sorted");
  relateClusters(surface);
}

bool SelfExclusion::excludesGroups(int g, int h) const {
  if (g < 0 || h < 0) return false;
  if (g == h) return true;
  const auto first = neighbor_.begin() + offset_[static_cast<size_t>(g)];
  return std::binary_search(first, neighbor_.begin() + offset_[static_cast<size_t>(g) + 1], h);
}

bool SelfExclusion::excludes(const std::array<int, 3>& first, const std::array<int, 3>& second) const {
  for (const int v : first)
    for (const int w : second)
      if (v >= 0 && v == w) return true;
  if (group_.empty()) return false;
  for (const int v : first)
    for (const int w : second)
      if (v >= 0 && w >= 0 && excludesGroups(group_[static_cast<size_t>(v)], group_[static_cast<size_t>(w)]))
        return true;
  return false;
}

bool SelfExclusion::excludesAll(std::span<const int> groups, std::span<const int> others) const {
  for (const int g : groups)
    for (const int h : others)
      if (!excludesGroups(g, h)) return false;
  return true;
}

bool SelfExclusion::Relation::contains(int a, int b) const {
  if (offset.empty()) return false;
  const auto first = other.begin() + offset[static_cast<size_t>(a)];
  return std::binary_search(first, other.begin() + offset[static_cast<size_t>(a) + 1], b);
}

// By cluster: groups of its triangles' first vertices ("own") and of all of its vertices; the other way round, clusters
// by group and by vertex.
struct SelfExclusion::ClusterGroups {
  std::vector<std::vector<int>> own, all;                  // groups of each cluster, sorted; -1: no group
  std::vector<std::vector<int>> owners, users, at_vertex;  // clusters of each group (those two), of each vertex

  ClusterGroups(const CollisionSurface& surface, const std::vector<int>& group, std::size_t groups)
      : own(static_cast<size_t>(surface.clusters())),
        all(own.size()),
        owners(groups),
        users(groups),
        at_vertex(group.size()) {
    for (size_t c = 0; c < own.size(); ++c) {
      const int cluster = static_cast<int>(c);
      for (const int t : surface.trianglesOfCluster(cluster))
        own[c].push_back(group[static_cast<size_t>(surface.triangles()[static_cast<size_t>(t)][0])]);
      for (const int v : surface.verticesOfCluster(cluster)) {
        all[c].push_back(group[static_cast<size_t>(v)]);
        at_vertex[static_cast<size_t>(v)].push_back(cluster);
      }
      sortUnique(own[c]);
      sortUnique(all[c]);
      for (const int g : own[c])
        if (g >= 0) owners[static_cast<size_t>(g)].push_back(cluster);
      for (const int g : all[c])
        if (g >= 0) users[static_cast<size_t>(g)].push_back(cluster);
    }
  }
};

// Appends the clusters that `of` lists for group g and for its neighbors.
void SelfExclusion::addAround(int g, const std::vector<std::vector<int>>& of, std::vector<int>& out) const {
  const auto add = [&](int group) {
    const auto& more = of[static_cast<size_t>(group)];
    out.insert(out.end(), more.begin(), more.end());
  };
  add(g);
  const auto i = static_cast<size_t>(g);
  for (int k = offset_[i]; k < offset_[i + 1]; ++k) {
    const int h = neighbor_[static_cast<size_t>(k)];
    if (h >= 0 && static_cast<size_t>(h) + 1 < offset_.size()) add(h);
  }
}

// Clusters that are excluded as wholes from cluster c; only those near any one of its groups can be near all.
void SelfExclusion::relateExcluded(const ClusterGroups& groups, size_t c, std::vector<int>& near) {
  near.clear();
  const std::vector<int>& own = groups.own[c];
  if (!own.empty() && own.front() >= 0) addAround(own.front(), groups.owners, near);
  sortUnique(near);
  for (const int d : near)
    if (excludesAll(own, groups.own[static_cast<size_t>(d)])) excluded_clusters_.other.push_back(d);
  excluded_clusters_.endRow();
}

// Clusters with a vertex of cluster c, or with one of a group that excludes one of c's.
void SelfExclusion::relateTouching(const ClusterGroups& groups, std::span<const int> vertices, size_t c,
                                   std::vector<int>& near) {
  near.clear();
  for (const int g : groups.all[c])
    if (g >= 0) addAround(g, groups.users, near);
  for (const int v : vertices) {
    const auto& more = groups.at_vertex[static_cast<size_t>(v)];
    near.insert(near.end(), more.begin(), more.end());
  }
  sortUnique(near);
  touching_clusters_.other.insert(touching_clusters_.other.end(), near.begin(), near.end());
  touching_clusters_.endRow();
}

void SelfExclusion::relateClusters(const CollisionSurface& surface) {
  const ClusterGroups groups(surface, group_, offset_.size());
  excluded_clusters_.endRow();
  touching_clusters_.endRow();
  std::vector<int> near;
  for (int c = 0; c < surface.clusters(); ++c) {
    relateExcluded(groups, static_cast<size_t>(c), near);
    relateTouching(groups, surface.verticesOfCluster(c), static_cast<size_t>(c), near);
  }
}

}  // namespace palpate
