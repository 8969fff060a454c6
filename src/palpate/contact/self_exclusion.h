#pragma once

#include <array>
#include <span>
#include <vector>

#include "palpate/contact/collision_surface.h"

namespace palpate {

/// What must not touch within one surface; for this surface only, as its clusters are related beforehand. Features that
/// share a vertex never do; nor do those of excluded groups.
class SelfExclusion {
 public:
  SelfExclusion() = default;
  /// Vertices belong to groups (such as tetrahedra). Two features are excluded where any vertex of one and any vertex
  /// of the other are of the same group or of neighbors.
  /// @param group      of each vertex, >= 0; -1: none
  /// @param offset     neighbors of group g are neighbor[offset[g]] ... neighbor[offset[g + 1]]
  /// @param neighbor   sorted within each group; symmetric
  /// Throws InputError where sizes do not fit or indices are out of range.
  SelfExclusion(const CollisionSurface& surface, std::vector<int> group, std::vector<int> offset,
                std::vector<int> neighbor);

  bool excludesGroups(int g, int h) const;
  /// Shared vertices and groups; -1 in either list is skipped.
  bool excludes(const std::array<int, 3>& first, const std::array<int, 3>& second) const;
  /// Whether two clusters are excluded as wholes: the groups of all their triangles' first vertices exclude each other.
  bool excludesClusters(int a, int b) const { return excluded_clusters_.contains(a, b); }
  /// Whether any two features of these clusters may be excluded, or share a vertex.
  bool touchesClusters(int a, int b) const { return excluded_clusters_.empty() || touching_clusters_.contains(a, b); }

 private:
  struct Relation {  // of clusters
    std::vector<int> offset, other;
    bool empty() const { return offset.empty(); }
    bool contains(int a, int b) const;
    void endRow() { offset.push_back(static_cast<int>(other.size())); }
  };
  struct ClusterGroups;
  void relateClusters(const CollisionSurface& surface);
  void relateExcluded(const ClusterGroups& groups, size_t cluster, std::vector<int>& near);
  void relateTouching(const ClusterGroups& groups, std::span<const int> vertices, size_t cluster,
                      std::vector<int>& near);
  void addAround(int group, const std::vector<std::vector<int>>& of, std::vector<int>& out) const;
  bool excludesAll(std::span<const int> groups, std::span<const int> others) const;

  std::vector<int> group_, offset_, neighbor_;
  Relation excluded_clusters_;  // as wholes
  Relation touching_clusters_;  // not free of exclusion
};

}  // namespace palpate
