#include "palpate/mesh/polygon.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <numeric>
#include <random>
#include <string>

#include "palpate/mesh/surface_io.h"
#include "palpate/mesh/surface_repair.h"

namespace palpate {
namespace {

using Polygon = std::vector<Eigen::Vector2d>;

std::vector<std::array<int, 3>> cut(const std::vector<Vec3>& vertices, const std::vector<int>& corners) {
  std::vector<std::array<int, 3>> out(corners.size() - 2, {-1, -1, -1});
  long long looks = kPolygonLooks;
  cutPolygon(vertices, corners, looks, out.data());
  return out;
}

std::vector<std::array<int, 3>> fanOf(const std::vector<int>& corners) {
  std::vector<std::array<int, 3>> out;
  for (size_t k = 1; k + 1 < corners.size(); ++k) out.push_back({corners[0], corners[k], corners[k + 1]});
  return out;
}

std::vector<int> upTo(size_t n) {
  std::vector<int> out(n);
  std::iota(out.begin(), out.end(), 0);
  return out;
}

double areaOf(const Polygon& p) {
  double sum = 0;
  for (size_t k = 0; k < p.size(); ++k) {
    const auto& a = p[k];
    const auto& b = p[(k + 1) % p.size()];
    sum += 0.5 * (a.x() * b.y() - a.y() * b.x());
  }
  return sum;
}

double perimeterOf(const Polygon& p) {
  double sum = 0;
  for (size_t k = 0; k < p.size(); ++k) sum += (p[(k + 1) % p.size()] - p[k]).norm();
  return sum;
}

/// Of triangles as they lie, so that what lies the wrong way round shows.
double sumOfAreas(const std::vector<Vec3>& x, const std::vector<std::array<int, 3>>& triangles) {
  return measureSurface({x, triangles}).area;
}

/// A prism over a polygon, 1 high, as an OBJ file whose two polygons begin at the corner `first`, and turned so that
/// no face lies along the axes.
std::string prism(const Polygon& base, size_t first) {
  const Quat turn(Eigen::AngleAxisd(0.7, Vec3(1, -2, 0.5).normalized()));
  const size_t n = base.size();
  std::string obj;
  for (const double z : {0.0, 1.0})
    for (const auto& p : base) {
      const Vec3 x = turn * Vec3(p.x(), p.y(), z);
      obj += "v " + std::to_string(x.x()) + " " + std::to_string(x.y()) + " " + std::to_string(x.z()) + "\n";
    }
  std::string low = "f";
  std::string high = "f";
  for (size_t k = 0; k < n; ++k) {
    low += " " + std::to_string((first + n - k) % n + 1);
    high += " " + std::to_string((first + k) % n + n + 1);
    const size_t next = (k + 1) % n;
    for (const size_t v : {k, next, next + n, k + n})
      obj += (v == k ? "f " : " ") + std::to_string(v + 1) + (v == k + n ? "\n" : "");
  }
  return obj + low + "\n" + high + "\n";
}

void expectPrism(const Polygon& base, size_t first) {
  const RepairedSurface solid = repairSurface(readSurfaceFromMemory(prism(base, first), SurfaceFormat::obj));
  const SurfaceMeasures m = measureSurface(solid.surface);
  EXPECT_TRUE(solid.report.topology.closed());
  EXPECT_NEAR(m.volume / areaOf(base), 1, 1e-4);
  EXPECT_NEAR(m.area / (2 * areaOf(base) + perimeterOf(base)), 1, 1e-4);
}

Polygon star(std::mt19937& random, size_t corners, double least) {
  std::uniform_real_distribution<double> radius(least, 1);
  Polygon p;
  for (size_t k = 0; k < corners; ++k) {
    const double angle = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(corners);
    p.push_back(radius(random) * Eigen::Vector2d(std::cos(angle), std::sin(angle)));
  }
  return p;
}

TEST(Polygon, AnLIsOneWhicheverCornerItBeginsWith) {
  const Polygon l = {{0, 0}, {3, 0}, {3, 1}, {1, 1}, {1, 3}, {0, 3}};
  for (size_t first = 0; first < l.size(); ++first) expectPrism(l, first);
}

TEST(Polygon, EveryTextFormatIsCutAlike) {
  // A dart, whose fan from the first corner has a triangle the wrong way round.
  const std::string x = "0 0 0\n2 1 0\n0 2 0\n1 1 0\n";
  const Surface off = readSurfaceFromMemory("OFF\n4 1 0\n" + x + "4 0 1 2 3\n", SurfaceFormat::off);
  const Surface ply = readSurfaceFromMemory(
      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar int vertex_index\nend_header\n" +
          x + "4 0 1 2 3\n",
      SurfaceFormat::ply);
  const Surface obj =
      readSurfaceFromMemory("f 1 2 3 4\nv 0 0 0\nv 2 1 0\nv 0 2 0\nv 1 1 0\n", SurfaceFormat::obj);  // faces first
  for (const Surface& s : {off, ply, obj}) {
    EXPECT_EQ(s.triangles.size(), 2u);
    EXPECT_NEAR(measureSurface(s).area, 1, 1e-12);
  }
}

TEST(Polygon, WhereTheFanIsRightItStays) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> angle(0, 2 * std::numbers::pi);
  std::normal_distribution<double> wobble(0, 1e-3);
  for (int i = 0; i < 300; ++i) {
    std::vector<double> angles(3 + static_cast<size_t>(i % 20));
    for (double& a : angles) a = angle(random);
    std::sort(angles.begin(), angles.end());
    const Quat turn = Quat::UnitRandom();
    std::vector<Vec3> x;
    for (const double a : angles) x.push_back(turn * Vec3(5 + std::cos(a), 2 * std::sin(a), 0));
    // on edges, and a corner twice
    x.push_back(0.5 * (x.back() + x.front()));
    x.insert(x.begin() + 1, 0.3 * x[0] + 0.7 * x[1]);
    x.insert(x.begin() + 2, x[2]);
    EXPECT_EQ(cut(x, upTo(x.size())), fanOf(upTo(x.size())));
  }
  // Quads that are bent, convex as seen along their normal.
  for (int i = 0; i < 100; ++i) {
    std::vector<Vec3> x = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
    for (Vec3& v : x) v += Vec3(100 * wobble(random), 100 * wobble(random), 200 * wobble(random));
    EXPECT_EQ(cut(x, upTo(4)), fanOf(upTo(4)));
  }
  // The L, from the corner that sees all of it.
  const std::vector<Vec3> l = {{0, 0, 0}, {3, 0, 0}, {3, 1, 0}, {1, 1, 0}, {1, 3, 0}, {0, 3, 0}};
  EXPECT_EQ(cut(l, upTo(6)), fanOf(upTo(6)));
}

TEST(Polygon, StarsKeepTheirAreaAndVolume) {
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    const auto corners = static_cast<size_t>(4 + i % 60);
    expectPrism(star(random, corners, 0.1), static_cast<size_t>(i) % corners);
  }
}

TEST(Polygon, MayBeBentALittleAndHaveCornersInALineAndTwice) {
  std::mt19937 random(5);
  std::normal_distribution<double> height(0, 1e-3);
  for (int i = 0; i < 200; ++i) {
    const Polygon p = star(random, 5 + static_cast<size_t>(i % 30), 0.2);
    std::vector<Vec3> x;
    for (size_t k = 0; k < p.size(); ++k) {
      const auto& next = p[(k + 1) % p.size()];
      x.emplace_back(p[k].x(), p[k].y(), height(random));
      if (k % 3 == 0) x.push_back(Vec3(x.back()));
      for (int part = 1; part < 1 + i % 4; ++part) {
        const Eigen::Vector2d between = p[k] + 0.25 * part * (next - p[k]);
        x.emplace_back(between.x(), between.y(), height(random));
      }
    }
    EXPECT_NEAR(sumOfAreas(x, cut(x, upTo(x.size()))) / areaOf(p), 1, 2e-2);
  }
}

TEST(Polygon, MayHaveHolesThatBridgesJoinToItsRim) {
  // A plate with a row of square holes, each joined to the one before by an edge that runs there and back.
  for (const int holes : {1, 2, 5, 30}) {
    std::vector<Vec3> x = {{0, 0, 0}, {3.0 * holes, 0, 0}, {3.0 * holes, 3, 0}, {0, 3, 0}};
    for (int h = 0; h < holes; ++h)
      for (const auto& [u, v] : {std::pair(1, 1), std::pair(1, 2), std::pair(2, 2), std::pair(2, 1)})
        x.emplace_back(3 * h + u, v, 0);
    std::vector<int> corners = {0};
    for (int h = 0; h < holes; ++h)
      for (const int k : {0, 1, 2, 3}) corners.push_back(4 + 4 * h + k);
    for (int h = holes - 1; h >= 0; --h) {
      corners.push_back(4 + 4 * h);
      if (h > 0) corners.push_back(4 + 4 * h - 1);
    }
    corners.insert(corners.end(), {0, 1, 2, 3});
    const double area = 9.0 * holes - holes;
    for (size_t first = 0; first < corners.size(); ++first) {
      std::vector<int> turned = corners;
      std::rotate(turned.begin(), turned.begin() + static_cast<std::ptrdiff_t>(first), turned.end());
      EXPECT_NEAR(sumOfAreas(x, cut(x, turned)), area, 1e-9) << holes << " " << first;
    }
  }
}

TEST(Polygon, WithoutAreaOrCrossingItselfIsTheFan) {
  const std::vector<Vec3> x = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {0, 1, 0}, {2, 1, 0}};
  for (const std::vector<int>& corners : {std::vector{0, 1, 2, 3}, std::vector{0, 0, 0, 0, 0}, std::vector{0, 1, 0, 1},
                                          std::vector{0, 1, 4, 5}, std::vector{0, 4, 1, 5}})
    EXPECT_EQ(cut(x, corners), fanOf(corners));
}

TEST(Polygon, AnyCornersWillDo) {
  std::mt19937 random(7);
  std::uniform_int_distribution<int> grid(0, 4);
  for (int i = 0; i < 20000; ++i) {
    std::vector<Vec3> x(4 + static_cast<size_t>(i % 12));
    for (Vec3& v : x) v = Vec3(grid(random), grid(random), i % 3 == 0 ? grid(random) : 0);
    std::vector<int> corners(4 + static_cast<size_t>(i % 17));
    std::uniform_int_distribution<int> which(0, static_cast<int>(x.size()) - 1);
    for (int& c : corners) c = which(random);
    // As chains, the triangles bound what the corners go around: each edge that is not the polygon's own cancels.
    std::vector<std::vector<int>> net(x.size(), std::vector<int>(x.size(), 0));
    const auto go = [&](int a, int b, int sign) {
      net[static_cast<size_t>(a)][static_cast<size_t>(b)] += sign;
      net[static_cast<size_t>(b)][static_cast<size_t>(a)] -= sign;
    };
    for (const auto& t : cut(x, corners))
      for (size_t k = 0; k < 3; ++k) go(t[k], t[(k + 1) % 3], 1);
    for (size_t k = 0; k < corners.size(); ++k) go(corners[k], corners[(k + 1) % corners.size()], -1);
    for (const auto& row : net)
      for (const int n : row) ASSERT_EQ(n, 0) << i;
  }
}

TEST(Polygon, TenThousandCornersTakeFewLooks) {
  std::mt19937 random(9);
  const auto looksAt = [](const Polygon& p) {
    std::vector<Vec3> x;
    for (const auto& v : p) x.emplace_back(v.x(), v.y(), 0);
    const std::vector<int> corners = upTo(x.size());
    std::vector<std::array<int, 3>> out(corners.size() - 2);
    long long looks = kPolygonLooks;
    cutPolygon(x, corners, looks, out.data());
    EXPECT_NEAR(sumOfAreas(x, out) / areaOf(p), 1, 1e-9);
    return kPolygonLooks - looks;
  };
  EXPECT_LT(looksAt(star(random, 10000, 0.3)), 30'000'000);
  // A comb, whose teeth are longer than its back: any of them may stand in the way of an ear.
  Polygon comb = {{0, -1}, {0.5, -1}};
  for (int k = 0; k < 2500; ++k) {
    const double y = 1e-3 * k;
    comb.insert(comb.end(), {{0.5, y + 2e-4}, {9, y + 4e-4}, {9, y + 6e-4}, {0.5, y + 8e-4}});
  }
  comb.push_back({0, 2.5});
  EXPECT_LT(looksAt(comb), 30'000'000);
  // Without looks it is the fan.
  const std::vector<Vec3> dart = {{0, 0, 0}, {2, 1, 0}, {0, 2, 0}, {1, 1, 0}};
  std::vector<std::array<int, 3>> out(2);
  long long none = 0;
  cutPolygon(dart, upTo(4), none, out.data());
  EXPECT_EQ(out, fanOf(upTo(4)));
}

}  // namespace
}  // namespace palpate
