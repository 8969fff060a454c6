#include "palpate/mesh/surface_repair.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <unordered_map>

#include "palpate/common/error.h"
#include "palpate/mesh/edge_table.h"
#include "palpate/mesh/winding_number.h"

namespace palpate {
namespace {

constexpr double kLargestCapShare = 0.35;
constexpr size_t kMostNestedPatches = 32;

uint64_t cellKey(const Eigen::Matrix<int64_t, 3, 1>& c) {
  const auto mix = [](int64_t v, uint64_t prime) { return static_cast<uint64_t>(v) * prime; };
  return mix(c.x(), 73856093u) ^ mix(c.y(), 19349669663ull) ^ mix(c.z(), 83492791ull * 1000003ull);
}

/// For each vertex the first vertex within the tolerance of it.
std::vector<int> weldVertices(const std::vector<Vec3>& vertices, double tolerance) {
  const Vec3 low = boundsOf(vertices).low;
  const double size = std::max(4 * tolerance, 1e-300);
  const auto cellOf = [&](const Vec3& x) {
    return Eigen::Matrix<int64_t, 3, 1>(static_cast<int64_t>(std::floor((x.x() - low.x()) / size)),
                                        static_cast<int64_t>(std::floor((x.y() - low.y()) / size)),
                                        static_cast<int64_t>(std::floor((x.z() - low.z()) / size)));
  };
  // Only first vertices are stored, chained by cell; a point looks into the (at most eight) cells its tolerance
  // reaches.
  std::unordered_map<uint64_t, int> head;
  head.reserve(vertices.size());
  std::vector<int> next(vertices.size(), -1);
  std::vector<int> first(vertices.size());
  for (size_t v = 0; v < vertices.size(); ++v) {
    const Vec3& x = vertices[v];
    const auto from = cellOf(x - Vec3::Constant(tolerance));
    const auto to = cellOf(x + Vec3::Constant(tolerance));
    int found = -1;
    for (int64_t k = from.z(); k <= to.z(); ++k)
      for (int64_t j = from.y(); j <= to.y(); ++j)
        for (int64_t i = from.x(); i <= to.x(); ++i) {
          const auto it = head.find(cellKey({i, j, k}));
          for (int w = it == head.end() ? -1 : it->second; w >= 0; w = next[static_cast<size_t>(w)])
            if ((vertices[static_cast<size_t>(w)] - x).squaredNorm() <= tolerance * tolerance &&
                (found < 0 || w < found))
              found = w;
        }
    if (found < 0) {
      found = static_cast<int>(v);
      const auto [it, fresh] = head.try_emplace(cellKey(cellOf(x)), found);
      if (!fresh) {
        next[v] = it->second;
        it->second = found;
      }
    }
    first[v] = found;
  }
  return first;
}

double doubleArea(const Surface& s, const std::array<int, 3>& t) {
  const Vec3& a = s.vertices[static_cast<size_t>(t[0])];
  return (s.vertices[static_cast<size_t>(t[1])] - a).cross(s.vertices[static_cast<size_t>(t[2])] - a).norm();
}

bool isDegenerate(const Surface& surface, const std::array<int, 3>& t) {
  // Collinear corners may hold the surface together (a T-junction's filler), so only what has no length goes.
  return t[0] == t[1] || t[1] == t[2] || t[2] == t[0] || !(doubleArea(surface, t) >= 0);
}

/// Triangles on the same three corners as another one, that run around like it or the other way.
struct Repeated {
  std::vector<char> again;     ///< same corners as an earlier one
  std::vector<char> opposite;  ///< of those left, such that one of those that go ran the other way
};

Repeated repeatedTriangles(const std::vector<std::array<int, 3>>& triangles) {
  std::vector<int> order(triangles.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
  std::vector<std::array<int, 3>> keys = triangles;
  std::vector<char> even(triangles.size());
  for (size_t i = 0; i < keys.size(); ++i) {
    const auto& t = triangles[i];
    even[i] = static_cast<char>((t[0] < t[1]) ^ (t[1] < t[2]) ^ (t[2] < t[0]));
    std::sort(keys[i].begin(), keys[i].end());
  }
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    const auto& ka = keys[static_cast<size_t>(a)];
    const auto& kb = keys[static_cast<size_t>(b)];
    return ka < kb || (ka == kb && a < b);
  });
  Repeated repeated{std::vector<char>(triangles.size(), 0), std::vector<char>(triangles.size(), 0)};
  size_t first = 0;
  for (size_t i = 1; i < order.size(); ++i) {
    const auto t = static_cast<size_t>(order[i]);
    const auto kept = static_cast<size_t>(order[first]);
    if (keys[t] == keys[kept]) {
      repeated.again[t] = 1;
      if (even[t] != even[kept]) repeated.opposite[kept] = 1;
    } else {
      first = i;
    }
  }
  return repeated;
}

/// Which of the walls, triangles that come both ways round, lie between solids that touch there, and are to go. Walls
/// that share edges are one sheet. A sheet goes where the triangles around it are closed without it: they come to its
/// edges in even numbers. A leaf whose every triangle is there for either side stays, and what closes a hole.
std::vector<char> innerWalls(const Surface& surface, const std::vector<char>& wall) {
  const std::vector<EdgeUse> edges = edgeTable(surface);
  DisjointSets sheets(static_cast<int>(surface.triangles.size()));
  const auto isWall = [&](const EdgeUse& use) { return wall[static_cast<size_t>(use.triangle)] != 0; };
  forEachEdge(edges, [&](const EdgeUse* first, const EdgeUse* last) {
    const EdgeUse* const one = std::find_if(first, last, isWall);
    for (const EdgeUse* use = one; use != last; ++use)
      if (isWall(*use)) sheets.unite(one->triangle, use->triangle);
  });
  // By sheet, how many edges are closed without it, less those that are not.
  std::vector<int> closed(surface.triangles.size(), 0);
  forEachEdge(edges, [&](const EdgeUse* first, const EdgeUse* last) {
    const auto walls = std::count_if(first, last, isWall);
    const auto others = last - first - walls;
    if (walls == 0 || (walls > 1 && others == 0)) return;
    const int sheet = sheets.find(std::find_if(first, last, isWall)->triangle);
    closed[static_cast<size_t>(sheet)] += others > 0 && others % 2 == 0 ? 1 : -1;
  });
  std::vector<char> inner(surface.triangles.size(), 0);
  for (size_t t = 0; t < inner.size(); ++t)
    inner[t] = wall[t] != 0 && closed[static_cast<size_t>(sheets.find(static_cast<int>(t)))] > 0;
  return inner;
}

/// Leaves out triangles that are marked; returns how many.
template <class T>
int leaveOut(std::vector<T>& list, const std::vector<char>& marked) {
  size_t kept = 0;
  for (size_t i = 0; i < list.size(); ++i)
    if (!marked[i]) list[kept++] = list[i];
  const auto gone = static_cast<int>(list.size() - kept);
  list.resize(kept);
  return gone;
}

void dropBadTriangles(Surface& surface, double diagonal, RepairReport& report) {
  std::vector<char> bad;
  bad.reserve(surface.triangles.size());
  for (const auto& t : surface.triangles) bad.push_back(!(diagonal > 0) || isDegenerate(surface, t));
  report.degenerate_triangles += leaveOut(surface.triangles, bad);
  Repeated repeated = repeatedTriangles(surface.triangles);
  report.duplicate_triangles += leaveOut(surface.triangles, repeated.again);
  leaveOut(repeated.opposite, repeated.again);
  if (std::find(repeated.opposite.begin(), repeated.opposite.end(), 1) == repeated.opposite.end()) return;
  report.duplicate_triangles += leaveOut(surface.triangles, innerWalls(surface, repeated.opposite));
}

/// Neighbors across edges with exactly two triangles, and whether the pair disagrees in orientation.
struct Adjacency {
  std::vector<std::array<int, 3>> neighbor;
  std::vector<std::array<bool, 3>> disagrees;
};

Adjacency manifoldAdjacency(const Surface& surface) {
  Adjacency adjacency;
  adjacency.neighbor.assign(surface.triangles.size(), {-1, -1, -1});
  adjacency.disagrees.assign(surface.triangles.size(), {false, false, false});
  const auto add = [&](int from, int to, bool disagrees) {
    auto& row = adjacency.neighbor[static_cast<size_t>(from)];
    for (size_t k = 0; k < 3; ++k) {
      if (row[k] >= 0) continue;
      row[k] = to;
      adjacency.disagrees[static_cast<size_t>(from)][k] = disagrees;
      return;
    }
  };
  forEachEdge(edgeTable(surface), [&](const EdgeUse* first, const EdgeUse* last) {
    if (last - first != 2) return;
    const bool disagrees = first[0].forward == first[1].forward;
    add(first[0].triangle, first[1].triangle, disagrees);
    add(first[1].triangle, first[0].triangle, disagrees);
  });
  return adjacency;
}

/// Patch of each triangle and whether it is to be turned so that the patch agrees with its majority.
struct Patches {
  std::vector<int> patch;
  std::vector<char> turned;
  int count = 0;
};

Patches orientPatches(const Surface& surface) {
  const Adjacency adjacency = manifoldAdjacency(surface);
  const size_t n = surface.triangles.size();
  Patches patches{std::vector<int>(n, -1), std::vector<char>(n, 0), 0};
  std::vector<int> members;
  for (size_t seed = 0; seed < n; ++seed) {
    if (patches.patch[seed] >= 0) continue;
    members.assign(1, static_cast<int>(seed));
    patches.patch[seed] = patches.count;
    double kept_area = 0;
    double turned_area = 0;
    for (size_t i = 0; i < members.size(); ++i) {
      const auto t = static_cast<size_t>(members[i]);
      (patches.turned[t] ? turned_area : kept_area) += doubleArea(surface, surface.triangles[t]);
      for (size_t k = 0; k < 3; ++k) {
        const int other = adjacency.neighbor[t][k];
        if (other < 0 || patches.patch[static_cast<size_t>(other)] >= 0) continue;
        patches.patch[static_cast<size_t>(other)] = patches.count;
        patches.turned[static_cast<size_t>(other)] =
            static_cast<char>(patches.turned[t] ^ (adjacency.disagrees[t][k] ? 1 : 0));
        members.push_back(other);
      }
    }
    if (turned_area > kept_area)
      for (int t : members) patches.turned[static_cast<size_t>(t)] ^= 1;
    ++patches.count;
  }
  return patches;
}

void turn(std::array<int, 3>& t) { std::swap(t[1], t[2]); }

/// One surface a patch, each with its holes capped, so that each has a volume of its own.
std::vector<Surface> cappedPatches(const Surface& surface, const Patches& patches) {
  std::vector<Surface> parts(static_cast<size_t>(patches.count));
  std::vector<int> local(surface.vertices.size(), -1);
  std::vector<int> owner(surface.vertices.size(), -1);
  std::vector<std::vector<int>> members(parts.size());
  for (size_t t = 0; t < surface.triangles.size(); ++t)
    members[static_cast<size_t>(patches.patch[t])].push_back(static_cast<int>(t));
  for (size_t p = 0; p < parts.size(); ++p) {
    for (int t : members[p]) {
      std::array<int, 3> corners = surface.triangles[static_cast<size_t>(t)];
      for (int& v : corners) {
        const auto g = static_cast<size_t>(v);
        if (owner[g] != static_cast<int>(p)) {
          owner[g] = static_cast<int>(p);
          local[g] = static_cast<int>(parts[p].vertices.size());
          parts[p].vertices.push_back(surface.vertices[g]);
        }
        v = local[g];
      }
      parts[p].triangles.push_back(corners);
    }
    parts[p] = capHoles(parts[p]);
  }
  return parts;
}

Vec3 pointOn(const Surface& part) {
  const auto& t = part.triangles.front();
  return (part.vertices[static_cast<size_t>(t[0])] + part.vertices[static_cast<size_t>(t[1])] +
          part.vertices[static_cast<size_t>(t[2])]) /
         3;
}

/// The patch of least volume that encloses patch p, -1 if none does.
int enclosing(const std::vector<Surface>& parts, const std::vector<double>& volume, size_t p) {
  int best = -1;
  for (size_t q = 0; q < parts.size(); ++q) {
    if (std::abs(volume[q]) <= std::abs(volume[p])) continue;
    if (best >= 0 && std::abs(volume[q]) >= std::abs(volume[static_cast<size_t>(best)])) continue;
    if (std::abs(WindingNumber(parts[q]).exactAt(pointOn(parts[p]))) > 0.5) best = static_cast<int>(q);
  }
  return best;
}

/// Which patches are to be turned: those that face inward, unless another patch encloses them. Those are turned with
/// the patch around them, so that a cavity stays one.
std::vector<char> inwardPatches(const std::vector<Surface>& parts) {
  std::vector<double> volume;
  std::vector<size_t> order;
  for (const Surface& part : parts) {
    order.push_back(volume.size());
    volume.push_back(measureSurface(part).volume);
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return std::abs(volume[a]) > std::abs(volume[b]); });
  std::vector<char> inward(parts.size(), 0);
  for (size_t i = 0; i < order.size(); ++i) {
    const size_t p = order[i];
    // Beyond the largest patches, fragments: too many to ask each about each.
    const int around = i < kMostNestedPatches && volume[p] != 0 ? enclosing(parts, volume, p) : -1;
    inward[p] = around >= 0 ? inward[static_cast<size_t>(around)] : volume[p] < 0;
  }
  return inward;
}

}  // namespace

RepairedSurface repairSurface(const Surface& input, const RepairOptions& options) {
  RepairedSurface result;
  RepairReport& report = result.report;
  Surface surface = input;
  const double diagonal = boundsOf(input.vertices).diagonal();
  const std::vector<int> first = weldVertices(input.vertices, options.weld_tolerance * diagonal);
  for (size_t v = 0; v < first.size(); ++v) report.welded_vertices += first[v] != static_cast<int>(v);
  for (auto& t : surface.triangles)
    for (int& v : t) v = first[static_cast<size_t>(v)];
  dropBadTriangles(surface, diagonal, report);

  const Patches patches = orientPatches(surface);
  Surface agreeing = surface;
  for (size_t t = 0; t < agreeing.triangles.size(); ++t)
    if (patches.turned[t]) turn(agreeing.triangles[t]);
  const std::vector<char> inward = inwardPatches(cappedPatches(agreeing, patches));
  for (size_t t = 0; t < surface.triangles.size(); ++t) {
    if ((patches.turned[t] ^ inward[static_cast<size_t>(patches.patch[t])]) == 0) continue;
    turn(surface.triangles[t]);
    ++report.flipped_triangles;
  }

  // Compact the vertices, in their old order.
  std::vector<int> renumbered(surface.vertices.size(), -1);
  for (const auto& t : surface.triangles)
    for (int v : t) renumbered[static_cast<size_t>(v)] = 0;
  for (size_t v = 0; v < surface.vertices.size(); ++v) {
    if (renumbered[v] < 0) {
      report.unused_vertices += first[v] == static_cast<int>(v);
      continue;
    }
    renumbered[v] = static_cast<int>(result.surface.vertices.size());
    result.surface.vertices.push_back(surface.vertices[v]);
  }
  for (auto& t : surface.triangles)
    for (int& v : t) v = renumbered[static_cast<size_t>(v)];
  result.surface.triangles = std::move(surface.triangles);
  for (int v : first) result.vertex_map.push_back(renumbered[static_cast<size_t>(v)]);
  report.topology = inspectTopology(result.surface);
  return result;
}

void requireSolid(const Surface& surface, const std::string& name) {
  if (surface.triangles.empty()) throw InputError(name, "", "has no triangles");
  for (const Vec3& x : surface.vertices)
    if (!x.allFinite()) throw InputError(name, "", "has a vertex that is not finite");
  const Surface capped = capHoles(surface);
  const double area = measureSurface(surface).area;
  const SurfaceMeasures whole = measureSurface(capped);
  const double diagonal = boundsOf(surface.vertices).diagonal();
  const int open = inspectTopology(surface).boundary_edges;
  if (whole.area - area > kLargestCapShare * area)
    throw InputError(name, "",
                     "is not a closed surface: closing its " + std::to_string(open) + " boundary edges takes " +
                         std::to_string(static_cast<int>(100 * (whole.area - area) / whole.area)) +
                         " % of the whole area");
  if (!(whole.volume > 1e-9 * diagonal * diagonal * diagonal))
    throw InputError(name, "", "is not a closed surface: it bounds no volume");
}

}  // namespace palpate
