// Finding pairs must not allocate once it has seen the like. Counts calls of malloc itself.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "palpate/contact/contact_finder.h"
#include "palpate/contact/surface_contacts.h"
#include "palpate/contact/surface_pairs.h"
#include "palpate/mesh/embed_surface.h"
#include "shared/count_allocations.h"
#include "shared/surface_motions.h"

namespace palpate {
namespace {

using namespace test;

TEST(SurfacePairsAllocation, NoneInSteadyState) {
  if (!kCountsMalloc) GTEST_SKIP() << "malloc belongs to the sanitizer";
  CollisionSurface a(sphereSurface(0.03, 4)), b(sphereSurface(0.03, 4));
  const SelfExclusion exclusion;
  SurfacePairFinder finder;
  std::vector<FeaturePair> pairs;
  size_t found = 0;
  const auto step = [&](int i) {
    const double x = 1e-4 * (i % 7), y = 0.06 * (i % 3);  // rest, impact, throw
    place(b, affine(Mat3::Identity(), Vec3(x, 0, 0.0602)), affine(Mat3::Identity(), Vec3(-x, 0, 0.0601 - y)));
    a.refit();
    pairs.clear();
    finder.find(a, b, 1e-3, pairs);
    finder.findSelf(a, exclusion, 1e-3, pairs);
    found += pairs.size();
  };
  for (int i = 0; i < 21; ++i) step(i);
  found = 0;
  allocations = 0;
  counting = true;
  for (int i = 0; i < 21; ++i) step(i);
  counting = false;
  EXPECT_GT(found, 100u);
  EXPECT_EQ(allocations, 0);
  counting = true;
  auto* probe = new std::vector<int>(100);  // the counter does count
  counting = false;
  delete probe;
  EXPECT_GE(allocations, 2);
}

SimulationMesh softSphere() {
  EmbedOptions options;
  options.target_tetrahedra = 100;
  return embedSurface(sphereSurface(0.03, 4), options);
}

VecX translated(const SimulationMesh& mesh, const Vec3& offset) {
  VecX x(static_cast<Eigen::Index>(3 * mesh.mesh.nodes.size()));
  for (size_t i = 0; i < mesh.mesh.nodes.size(); ++i)
    x.segment<3>(static_cast<Eigen::Index>(3 * i)) = mesh.mesh.nodes[i] + offset;
  return x;
}

constexpr double kBarLength = 0.2;

// A bar along x bent into a ring about y whose end faces stay `gap` apart.
VecX bentToRing(const SimulationMesh& bar, double gap) {
  VecX x = translated(bar, Vec3::Zero());
  const double radius = (kBarLength + gap) / (2 * std::numbers::pi);
  for (Eigen::Index i = 0; i < x.size(); i += 3) {
    const Vec3 p = x.segment<3>(i);
    const double angle = p.x() / radius, distance = radius + p.z();
    x.segment<3>(i) = Vec3(distance * std::sin(angle), p.y(), distance * std::cos(angle));
  }
  return x;
}

// Two soft spheres pressed on each other and a bar bent until its ends meet, as a step asks for them: all positions
// computed beforehand.
TEST(SurfaceContactsAllocation, NoneInSteadyState) {
  if (!kCountsMalloc) GTEST_SKIP() << "malloc belongs to the sanitizer";
  constexpr int kSteps = 14;
  const SimulationMesh sphere = softSphere();
  const SimulationMesh bar = barMesh(Vec3(kBarLength, 0.02, 0.01), {30, 4, 2});
  SurfaceContacts contacts;
  contacts.addBody(0, sphere, true);
  contacts.addBody(1, sphere, false);
  contacts.addBody(2, bar, true);
  FrictionTable friction;
  for (int b = 0; b < 3; ++b) friction.setBody(b, 0.5);
  friction.setPair(0, 1, 0.3);
  std::vector<std::array<VecX, 3>> start, end;
  for (int i = 0; i < kSteps; ++i) {
    const double slide = 2e-4 * (i % 7), press = 3e-4 * (i % 3);  // near, touching, hitting
    start.push_back({translated(sphere, Vec3::Zero()), translated(sphere, Vec3(slide, 0, 0.0602)),
                     bentToRing(bar, 2e-4 + 1e-5 * (i % 5))});
    end.push_back({translated(sphere, Vec3(0, slide, 0)), translated(sphere, Vec3(-slide, 0, 0.0601 - press)),
                   bentToRing(bar, 2e-4 - 1e-4 * (i % 4))});
    for (auto* placed : {&start, &end})
      for (Eigen::Index k = 0; k < placed->back()[2].size(); k += 3)
        placed->back()[2][k] += 0.5;  // away from the others
  }
  const ContactSettings settings;
  std::vector<Contact> found;
  size_t between = 0, within = 0;
  const auto step = [&](int i) {
    for (int b = 0; b < 3; ++b) contacts.setStart(b, start[static_cast<size_t>(i)][static_cast<size_t>(b)]);
    contacts.examineOverlaps(false);
    for (int b = 0; b < 3; ++b) contacts.setEnd(b, end[static_cast<size_t>(i)][static_cast<size_t>(b)]);
    found.clear();
    contacts.findOverlapping(settings, friction, found);
    contacts.find(settings, friction, found);
    for (const Contact& c : found) ++(c.first.body == c.second.body ? within : between);
    const auto last = found.size();
    for (size_t k = 0; k < last; ++k) contacts.follow(Contact(found[k]), settings, friction, found);
  };
  for (int i = 0; i < kSteps; ++i) step(i);
  EXPECT_EQ(contacts.overlap(), 0.0);
  between = within = 0;
  allocations = 0;
  counting = true;
  for (int i = 0; i < kSteps; ++i) step(i);
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(between, 50u);
  EXPECT_GT(within, 50u);
}

TEST(ContactFinderAllocation, NoneInSteadyState) {
  if (!kCountsMalloc) GTEST_SKIP() << "malloc belongs to the sanitizer";
  constexpr int kSteps = 10;
  const SimulationMesh sphere = softSphere();
  const ContactFinder finder(sphere);
  const std::vector<Obstacle> obstacles{{PlaneShape{Vec3(0, 0, -0.0301), Vec3::UnitZ()}, 0.5, "ground"},
                                        {PlaneShape{Vec3(0.0301, 0, 0), -Vec3::UnitX()}, 0.5, "wall"}};
  std::vector<VecX> x;
  for (int i = 0; i <= kSteps; ++i) x.push_back(translated(sphere, Vec3(2e-4 * (i % 4), 0, -2e-4 * (i % 5))));
  std::vector<Contact> found;
  std::vector<int> nodes;
  size_t candidates = 0, followed = 0;
  const auto step = [&](size_t i) {
    found.clear();
    nodes.clear();
    finder.find(0, x[i], x[i + 1], obstacles, 2e-4, found);
    finder.nearbyNodes(x[i + 1], obstacles, 1e-3, nodes);
    candidates += found.size();
    for (const Contact& c : found) followed += finder.follow(c, x[i], x[i + 1], obstacles).key == c.key ? 1 : 0;
  };
  for (size_t i = 0; i < kSteps; ++i) step(i);
  candidates = followed = 0;
  allocations = 0;
  counting = true;
  for (size_t i = 0; i < kSteps; ++i) step(i);
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(candidates, 50u);
  EXPECT_EQ(followed, candidates);
}

}  // namespace
}  // namespace palpate
