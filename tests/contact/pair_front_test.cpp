// Searches that go on from earlier ones find what searches from the roots find, to the bit.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

#include "palpate/contact/surface_contacts.h"
#include "palpate/contact/surface_pairs.h"
#include "palpate/mesh/embed_surface.h"
#include "shared/surface_motions.h"

namespace palpate {
namespace {

using namespace test;

auto valuesOf(const FeaturePair& p) {
  return std::tuple(p.kind, p.first_feature, p.second_feature, p.hit, p.toi, p.start_distance, p.end_distance,
                    p.normal.x(), p.normal.y(), p.normal.z());
}

void expectSame(const std::vector<FeaturePair>& p, const std::vector<FeaturePair>& q, int step) {
  ASSERT_EQ(p.size(), q.size()) << "step " << step;
  for (size_t i = 0; i < p.size(); ++i) EXPECT_EQ(valuesOf(p[i]), valuesOf(q[i])) << "step " << step;
}

// What the starts have moved since the last search.
class Starts {
 public:
  explicit Starts(const CollisionSurface& s) : last_(s.start) {}
  MotionBounds moved(const CollisionSurface& s) {
    MotionBounds bounds;
    bounds.least.setConstant(1e300);
    bounds.greatest.setConstant(-1e300);
    for (size_t v = 0; v < last_.size(); ++v) {
      bounds.least = bounds.least.cwiseMin(s.start[v] - last_[v]);
      bounds.greatest = bounds.greatest.cwiseMax(s.start[v] - last_[v]);
    }
    last_ = s.start;
    return bounds;
  }

 private:
  std::vector<Vec3> last_;
};

Eigen::Affine3d near(Chance& chance, const Vec3& center, double wobble) {
  return affine(Mat3::Identity() + 0.05 * wobble * Mat3(Mat3::NullaryExpr([&] { return chance.in(-1, 1); })),
                center + chance.vector(0.002 * wobble));
}

TEST(PairFront, TwoSurfacesThatDeformRubPartAndCollide) {
  Chance chance(21);
  size_t found = 0, hits = 0;
  for (int world = 0; world < 6; ++world) {
    CollisionSurface a(chance.surface()), b(sphereSurface(0.02, 3));
    Starts of_a(a), of_b(b);
    SurfacePairFinder finder;
    PairFront front;
    Eigen::Affine3d at_a = near(chance, Vec3::Zero(), 1), at_b = near(chance, Vec3(0, 0, 0.05), 1);
    for (int step = 0; step < 80; ++step) {
      // slow waves towards each other and apart, at times far in one step
      const double height = 0.04 + 0.01 * std::cos(0.15 * step) + (step % 17 == 0 ? chance.in(-0.02, 0.06) : 0.0);
      const Eigen::Affine3d next_a = near(chance, Vec3::Zero(), 0.2), next_b = near(chance, Vec3(0, 0, height), 0.2);
      std::vector<FeaturePair> kept, fresh;
      for (int pass = 0; pass < 3; ++pass) {  // from one start to several ends
        const Eigen::Affine3d end_b = pass == 2 ? next_b : affine(next_b.linear(), next_b * chance.vector(0.004));
        place(a, at_a, next_a);
        place(b, at_b, end_b);
        front.moved(relativeMotion(of_a.moved(a), of_b.moved(b)));
        kept.clear();
        fresh.clear();
        finder.find(a, b, 5e-4, kept, &front);
        finder.find(a, b, 5e-4, fresh);
        expectSame(kept, fresh, step);
        found += fresh.size();
        for (const FeaturePair& p : fresh) hits += p.hit ? 1 : 0;
      }
      at_a = next_a;
      at_b = next_b;
    }
  }
  EXPECT_GT(found, 500u);
  EXPECT_GT(hits, 100u);
}

TEST(PairFront, OneSurfaceThatCurlsUpAndOpens) {
  const int cells = 60;
  CollisionSurface s(strip(cells), [&] {
    std::vector<int> cluster;
    for (int i = 0; i < 4 * cells; ++i) cluster.push_back(i / 12);
    return cluster;
  }());
  std::vector<int> group, offset{0}, neighbor;
  for (size_t i = 0; i < s.rest().size(); ++i) group.push_back(static_cast<int>(i) / 3);
  for (int g = 0; g <= cells; ++g) {
    for (int h = std::max(0, g - 6); h <= std::min(cells, g + 6); ++h) neighbor.push_back(h);
    offset.push_back(static_cast<int>(neighbor.size()));
  }
  const SelfExclusion exclusion(s, group, offset, neighbor);
  SurfacePairFinder finder;
  PairFront front;
  Starts starts(s);
  double angle = 5.0;
  size_t found = 0;
  for (int step = 0; step < 300; ++step) {
    const double next = 5.7 + 0.7 * std::sin(0.05 * step) + (step % 50 == 49 ? -1.0 : 0.0);
    bend(s, s.start, angle);
    bend(s, s.end, next);
    s.refit();
    const MotionBounds moved = starts.moved(s);
    front.moved(relativeMotion(moved, moved));
    std::vector<FeaturePair> kept, fresh;
    finder.findSelf(s, exclusion, 1e-3, kept, &front);
    finder.findSelf(s, exclusion, 1e-3, fresh);
    expectSame(kept, fresh, step);
    found += fresh.size();
    angle = next;
  }
  EXPECT_GT(found, 100u);
}

// Triangles that share a vertex touch; what counts is how far apart the features are that could come together.
TEST(PairFront, NeighborsOfOneSurfaceAreNotLookedAtAgainWhileNothingMoves) {
  CollisionSurface s(sphereSurface(0.02, 3));
  place(s, Eigen::Affine3d::Identity(), Eigen::Affine3d::Identity());
  const SelfExclusion exclusion;
  SurfacePairFinder finder;
  PairFront front;
  std::vector<FeaturePair> found;
  const auto tested = [&](double moved) {
    finder.allow(1e9);
    front.moved(moved);
    finder.findSelf(s, exclusion, 2e-4, found, &front);
    return finder.tested();
  };
  const double all = tested(0);
  EXPECT_GT(all, 10);
  EXPECT_EQ(tested(0), 0);
  EXPECT_LT(tested(1e-4), 0.5 * all);
  EXPECT_GE(tested(0.02), all);  // any two may have come together
  EXPECT_TRUE(found.empty());
}

// Of two balls that touch, one is thrown through the other: a search that stops on the way costs the next ones nothing,
// whether it stops in the trees (one piece of time) or among what meets (many).
TEST(PairFront, ASearchThatIsGivenUpLeavesWhatWasKnown) {
  for (const int pieces : {1, 8}) {
    CollisionSurface a(sphereSurface(0.02, 3)), b(sphereSurface(0.02, 3));
    const auto at = [](double height) { return affine(Mat3::Identity(), Vec3(0, 0, height)); };
    PairSettings settings;
    settings.max_pieces = pieces;
    SurfacePairFinder finder(settings);
    PairFront front;
    std::vector<FeaturePair> kept, fresh;
    const auto search = [&](double height, double allowed) {
      place(a, at(0), at(0));
      place(b, at(0.0401), at(height));
      front.moved(0);
      finder.allow(allowed);
      kept.clear();
      finder.find(a, b, 2e-4, kept, &front);
      return finder.tested();
    };
    const double first = search(0.0401, 1e9), calm = search(0.0401, 1e9);
    ASSERT_LT(calm, 0.7 * first);
    search(0.0, 5);
    ASSERT_TRUE(finder.gaveUp());
    search(0.0, 5);
    ASSERT_TRUE(finder.gaveUp());
    EXPECT_LE(search(0.0401, 1e9), calm) << pieces;
    finder.find(a, b, 2e-4, fresh);
    EXPECT_FALSE(fresh.empty());
    expectSame(kept, fresh, pieces);
    search(0.03, 1e9);
    fresh.clear();
    finder.find(a, b, 2e-4, fresh);
    expectSame(kept, fresh, pieces);
  }
}

// Positions of nodes, and with them bounds, come by another way here: from one step's end, from a jump, from a cut
// path.
TEST(PairFront, BodiesOfAWorldStepByStep) {
  Chance chance(5);
  EmbedOptions options;
  options.target_tetrahedra = 150;
  const SimulationMesh mesh = embedSurface(sphereSurface(0.03, 4), options);
  const auto positions = [&](const Vec3& offset, double strain) {
    VecX x(static_cast<Eigen::Index>(3 * mesh.mesh.nodes.size()));
    for (size_t i = 0; i < mesh.mesh.nodes.size(); ++i)
      x.segment<3>(static_cast<Eigen::Index>(3 * i)) = (1.0 + chance.in(-strain, strain)) * mesh.mesh.nodes[i] + offset;
    return x;
  };
  const auto surfaces = [&] {
    SurfaceContacts s;
    s.addBody(0, mesh, true);
    s.addBody(1, mesh, true);
    s.addObstacle(0, boxSurface(Vec3(0.2, 0.2, 0.01), {4, 4, 1}));
    return s;
  };
  FrictionTable friction;
  friction.setBody(0, 0.5);
  friction.setBody(1, 0.5);
  friction.setObstacle(0, 0.5);
  SurfaceContacts kept = surfaces();
  const ContactSettings settings;
  VecX a = positions(Vec3(0, 0, 0.037), 0), b = positions(Vec3(0, 0.002, 0.099), 0);
  size_t found = 0;
  for (int step = 0; step < 60; ++step) {
    const double lift = 0.002 * std::sin(0.4 * step);
    if (step % 13 == 12) b = positions(Vec3(0, 0.003, 0.1), 0.001);  // set from outside
    const VecX next_a = positions(Vec3(0.0002 * (step % 5), 0, 0.0355 + 0.3 * lift), 0.002);
    const VecX next_b = positions(Vec3(0, 0.0002 * (step % 7), 0.0965 + lift), 0.002);
    kept.setStart(0, a);
    kept.setStart(1, b);
    for (const double share : {1.0, 0.6}) {
      SurfaceContacts fresh = surfaces();
      std::vector<Contact> of_kept, of_fresh;
      const VecX end_b = share == 1.0 ? next_b : VecX(b + share * (next_b - b));
      fresh.setStart(0, a);
      fresh.setStart(1, b);
      for (SurfaceContacts* s : {&kept, &fresh}) {
        s->setEnd(0, next_a);
        s->setEnd(1, end_b);
        s->find(settings, friction, s == &kept ? of_kept : of_fresh);
      }
      ASSERT_EQ(of_kept.size(), of_fresh.size()) << "step " << step;
      for (size_t i = 0; i < of_kept.size(); ++i) {
        EXPECT_EQ(of_kept[i].key, of_fresh[i].key) << "step " << step;
        EXPECT_EQ(of_kept[i].gap, of_fresh[i].gap) << "step " << step;
        EXPECT_EQ(of_kept[i].end_gap, of_fresh[i].end_gap) << "step " << step;
      }
      found += of_fresh.size();
    }
    b = step % 4 != 3 ? next_b : VecX(b + 0.6 * (next_b - b));  // at times the motion is cut
    a = next_a;
  }
  EXPECT_GT(found, 300u);
}

}  // namespace
}  // namespace palpate
