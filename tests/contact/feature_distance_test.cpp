#include "palpate/contact/feature_distance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace palpate {
namespace {

class FeatureDistance : public ::testing::Test {
 protected:
  Vec3 random(double size = 1) { return size * Vec3(unit_(rng_), unit_(rng_), unit_(rng_)); }
  double fraction() { return 0.5 * (1 + unit_(rng_)); }
  std::mt19937 rng_{7};
  std::uniform_real_distribution<double> unit_{-1, 1};
};

Vec3 onTriangle(const TrianglePoint& q, const Vec3& a, const Vec3& b, const Vec3& c) {
  return q.weight[0] * a + q.weight[1] * b + q.weight[2] * c;
}

void expectWeights(const TrianglePoint& q) {
  double sum = 0;
  for (const double w : q.weight) {
    EXPECT_GE(w, 0);
    sum += w;
  }
  EXPECT_NEAR(sum, 1, 1e-12);
}

double distanceOf(FeatureKind kind, const std::array<Vec3, 4>& x) {
  return kind == FeatureKind::vertex_face ? closestOnTriangle(x[0], x[1], x[2], x[3]).distance
                                          : closestOnSegments(x[0], x[1], x[2], x[3]).distance;
}

std::array<Vec3, 4> between(const std::array<Vec3, 4>& a, const std::array<Vec3, 4>& b, double t) {
  std::array<Vec3, 4> x;
  for (size_t i = 0; i < 4; ++i) x[i] = (1 - t) * a[i] + t * b[i];
  return x;
}

TEST_F(FeatureDistance, NoPointOfATriangleIsNearer) {
  for (int trial = 0; trial < 300; ++trial) {
    const Vec3 p = random(), a = random(), b = random(), c = random();
    const TrianglePoint q = closestOnTriangle(p, a, b, c);
    expectWeights(q);
    EXPECT_NEAR((p - onTriangle(q, a, b, c)).norm(), q.distance, 1e-12);
    for (int i = 0; i <= 30; ++i)
      for (int j = 0; i + j <= 30; ++j) {
        const Vec3 x = (i * a + j * b + (30 - i - j) * c) / 30;
        EXPECT_GE((p - x).norm(), q.distance - 1e-12);
      }
  }
}

TEST_F(FeatureDistance, NoPointsOfTwoSegmentsAreNearer) {
  for (int trial = 0; trial < 300; ++trial) {
    const Vec3 a0 = random(), a1 = random(), b0 = random(), b1 = random();
    const SegmentPair q = closestOnSegments(a0, a1, b0, b1);
    EXPECT_NEAR(((1 - q.s) * a0 + q.s * a1 - (1 - q.t) * b0 - q.t * b1).norm(), q.distance, 1e-12);
    for (int i = 0; i <= 20; ++i)
      for (int j = 0; j <= 20; ++j)
        EXPECT_GE((a0 + i / 20.0 * (a1 - a0) - b0 - j / 20.0 * (b1 - b0)).norm(), q.distance - 1e-12);
  }
}

TEST_F(FeatureDistance, NearlyParallelSegmentsAreExactToRounding) {
  for (int trial = 0; trial < 2000; ++trial) {
    const Vec3 a0 = random(), d = random(), b0 = a0 + random(0.1);
    const double angle = std::pow(10.0, -14 * fraction());
    const Vec3 a1 = a0 + d, b1 = b0 + d + random(angle);
    const SegmentPair q = closestOnSegments(a0, a1, b0, b1);
    double best = 1e300;  // alternating projections from a fine grid
    for (int i = 0; i <= 50; ++i) {
      double s = i / 50.0, t = 0;
      for (int k = 0; k < 4; ++k) {
        t = closestOnSegment(a0 + s * (a1 - a0), b0, b1);
        s = closestOnSegment(b0 + t * (b1 - b0), a0, a1);
      }
      best = std::min(best, (a0 + s * (a1 - a0) - b0 - t * (b1 - b0)).norm());
    }
    EXPECT_LE(q.distance, best + 1e-7);
    EXPECT_GE(q.s, 0);
    EXPECT_LE(q.s, 1);
    EXPECT_GE(q.t, 0);
    EXPECT_LE(q.t, 1);
  }
}

TEST_F(FeatureDistance, DegenerateFeaturesAreTheirPointsAndSegments) {
  const Vec3 o = Vec3::Zero(), x(1, 0, 0), p(0.25, 2, 0);
  for (const auto& q :
       {closestOnTriangle(p, o, o, x), closestOnTriangle(p, o, x, x), closestOnTriangle(p, x, o, 0.5 * x)}) {
    expectWeights(q);
    EXPECT_DOUBLE_EQ(q.distance, 2);
  }
  EXPECT_DOUBLE_EQ(closestOnTriangle(p, x, x, x).distance, (p - x).norm());
  EXPECT_DOUBLE_EQ(closestOnSegments(p, p, o, x).distance, 2);
  EXPECT_DOUBLE_EQ(closestOnSegments(o, x, p, p).distance, 2);
  EXPECT_DOUBLE_EQ(closestOnSegments(p, p, x, x).distance, (p - x).norm());
  EXPECT_DOUBLE_EQ(closestOnSegments(o, x, Vec3(3, 1, 0), Vec3(2, 1, 0)).distance, std::sqrt(2.0));
  EXPECT_DOUBLE_EQ(closestOnSegments(o, x, Vec3(0.5, 1, 0), Vec3(2, 1, 0)).distance, 1);
}

TEST_F(FeatureDistance, DetectionNeverMissesAndIsTight) {
  int hits = 0, misses = 0;
  for (int trial = 0; trial < 4000; ++trial) {
    const auto kind = trial % 2 == 0 ? FeatureKind::vertex_face : FeatureKind::edge_edge;
    std::array<Vec3, 4> a, b;
    const double size = std::pow(10.0, -3 * fraction()), speed = 3 * fraction();
    for (size_t i = 0; i < 4; ++i) {
      a[i] = random(size);
      b[i] = random(size) + (i == 0 ? random(speed) : Vec3::Zero());
    }
    const double start = distanceOf(kind, a), least = 0.1 * start;
    if (start < 1e-6 * size) continue;
    const Approach r = timeOfApproach(kind, a, b, least, 1000);
    double smallest = 1e300;
    for (int i = 0; i <= 400; ++i) {
      const double d = distanceOf(kind, between(a, b, r.time * i / 400));
      EXPECT_GT(d, least * (1 - 1e-9)) << trial;
      smallest = std::min(smallest, d);
    }
    if (r.reached) {
      ++hits;
      EXPECT_LE(smallest, least * 1.1 + 1e-12) << trial;
    } else {
      ++misses;
      EXPECT_EQ(r.time, 1);
    }
    const Approach shorter = timeOfApproach(kind, a, b, least, 3);
    EXPECT_LE(shorter.time, r.time + 1e-12);
    EXPECT_TRUE(shorter.reached || !r.reached);
  }
  EXPECT_GT(hits, 300);
  EXPECT_GT(misses, 300);
}

TEST_F(FeatureDistance, SlidingAlongAFaceIsOneStep) {
  // ten micrometers over a face, across all of it: the largest speed alone would need ten thousand steps
  const std::array<Vec3, 4> a{Vec3(-0.1, 0.02, 1e-5), Vec3(-0.05, -0.05, 0), Vec3(0.05, -0.05, 0), Vec3(0, 0.1, 0)};
  auto b = a;
  b[0].x() = 0.1;
  const Approach r = timeOfApproach(FeatureKind::vertex_face, a, b, 1e-6, 30);
  EXPECT_FALSE(r.reached);
  b[0].z() = -1e-5;
  const Approach hit = timeOfApproach(FeatureKind::vertex_face, a, b, 1e-6, 30);
  EXPECT_TRUE(hit.reached);
  EXPECT_NEAR(hit.time, 0.45, 0.01);
}

TEST_F(FeatureDistance, CommonMotionDoesNotMatter) {
  const std::array<Vec3, 4> a{Vec3(0, 0, 1), Vec3(-1, -1, 0), Vec3(1, -1, 0), Vec3(0, 1, 0)};
  auto b = a;
  for (Vec3& p : b) p += Vec3(1e3, -1e3, 1e3);
  EXPECT_FALSE(timeOfApproach(FeatureKind::vertex_face, a, b, 0.5).reached);
  b[0].z() -= 2;
  EXPECT_NEAR(timeOfApproach(FeatureKind::vertex_face, a, b, 0.1).time, 0.45, 0.005);
}

TEST_F(FeatureDistance, TouchingAtTheStartReturnsAtOnce) {
  const std::array<Vec3, 4> a{Vec3(0, 0, 0), Vec3(-1, -1, 0), Vec3(1, -1, 0), Vec3(0, 1, 0)};
  const Approach r = timeOfApproach(FeatureKind::vertex_face, a, a, 0);
  EXPECT_TRUE(r.reached);
  EXPECT_EQ(r.time, 0);
}

}  // namespace
}  // namespace palpate
