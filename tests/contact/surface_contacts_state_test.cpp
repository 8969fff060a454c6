// What SurfaceContacts keeps beside its state changes no bit: searches go on from a saved state as they would have.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "palpate/contact/surface_contacts.h"
#include "palpate/mesh/embed_surface.h"
#include "shared/surface_motions.h"

namespace palpate {
namespace {

constexpr double kRadius = 0.03;

const SimulationMesh& softSphere() {
  static const SimulationMesh mesh = [] {
    EmbedOptions options;
    options.target_tetrahedra = 150;
    return embedSurface(sphereSurface(kRadius, 4), options);
  }();
  return mesh;
}

// Two spheres that touch themselves, one on the other, the lower one on a fixed slab.
SurfaceContacts surfaces() {
  SurfaceContacts s;
  s.addBody(0, softSphere(), true);
  s.addBody(1, softSphere(), true);
  s.addObstacle(0, boxSurface(Vec3(0.2, 0.2, 0.01), {4, 4, 1}));
  return s;
}

// Of a sphere's nodes, each as far from its middle as `stretch` says.
template <class Stretch>
VecX positions(const Vec3& offset, const Stretch& stretch) {
  const auto& nodes = softSphere().mesh.nodes;
  VecX x(static_cast<Eigen::Index>(3 * nodes.size()));
  for (size_t i = 0; i < nodes.size(); ++i)
    x.segment<3>(static_cast<Eigen::Index>(3 * i)) = stretch() * nodes[i] + offset;
  return x;
}

FrictionTable friction() {
  FrictionTable table;
  table.setBody(0, 0.5);
  table.setBody(1, 0.5);
  table.setObstacle(0, 0.5);
  return table;
}

struct Motion {  // of both spheres in a step, first as predicted
  std::array<VecX, 2> start, predicted, end;
};

// The upper sphere starts in the lower one, leaves it and rubs on it. In one step of it, both are squeezed into each
// other without having been seen to overlap.
constexpr int kSteps = 40, kSqueezed = 30;
std::vector<Motion> motions() {
  test::Chance chance(5);
  const auto stretch = [&] { return 1.0 + chance.in(-0.002, 0.002); };
  std::vector<Motion> all;
  for (int i = 0; i < kSteps; ++i) {
    const double slide = 1.5e-3 * std::sin(0.3 * i),
                 apart = i < 5 || i == kSqueezed ? -0.001 : 1e-4 * std::cos(0.7 * i);
    const auto lower = [&] { return positions(Vec3(slide, 0, 0.0351), stretch); };
    const auto upper = [&](double closer) {
      return positions(Vec3(0, slide, 0.0351 + 2 * kRadius + apart - closer), stretch);
    };
    all.push_back({{lower(), upper(0)}, {lower(), upper(1e-4)}, {lower(), upper(4e-4)}});
    // mostly from where the last search ended
    if (i > 0 && i % 4 != 0 && i != kSqueezed) all.back().start = all[static_cast<size_t>(i) - 1].end;
  }
  return all;
}

// All that a step asks of the surfaces, in its order; `followed` are an earlier step's contacts.
std::vector<Contact> found(SurfaceContacts& s, const Motion& motion, const std::vector<Contact>& followed) {
  const ContactSettings settings;
  const FrictionTable table = friction();
  std::vector<Contact> out;
  for (int b = 0; b < 2; ++b) s.setStart(b, motion.start[static_cast<size_t>(b)]);
  s.examineOverlaps(false);
  for (int b = 0; b < 2; ++b) s.setEnd(b, motion.predicted[static_cast<size_t>(b)]);
  s.findOverlapping(settings, table, out);
  for (const Contact& c : followed) s.follow(c, settings, table, out);
  s.find(settings, table, out);
  for (int b = 0; b < 2; ++b) s.setEnd(b, motion.end[static_cast<size_t>(b)]);
  s.find(settings, table, out);
  return out;
}

struct Step {
  SurfaceContactsState state;  // before it
  std::vector<Contact> contacts;
  double overlap;
};

// Every step from the start, with all that is kept from step to step.
std::vector<Step> stepsOf(SurfaceContacts& s, const std::vector<Motion>& motion) {
  std::vector<Step> steps;
  for (size_t i = 0; i < motion.size(); ++i) {
    steps.push_back({s.state(), {}, 0});
    steps[i].contacts = found(s, motion[i], i == 0 ? std::vector<Contact>{} : steps[i - 1].contacts);
    steps[i].overlap = s.overlap();
  }
  return steps;
}

void expectSame(const std::vector<Contact>& p, const std::vector<Contact>& q, size_t step) {
  ASSERT_EQ(p.size(), q.size()) << "step " << step;
  for (size_t i = 0; i < p.size(); ++i) EXPECT_TRUE(p[i] == q[i]) << "step " << step << ", contact " << i;
}

// A sphere that is a little in the slab, on its way out: it is not held back by the face from behind. A step is, as
// its motion must not cross in either way.
TEST(SurfaceContactsAhead, WhatIsLeftFromInsideIsNotHit) {
  constexpr double kTop = 0.005, kIn = 1e-4;
  const auto at = [](double height) { return positions(Vec3(0.011, 0.007, height), [] { return 1.0; }); };
  const auto normals = [&](bool ahead, double from, double to) {
    SurfaceContacts s = surfaces();
    s.setAhead(ahead);
    s.setStart(0, at(kTop + kRadius + from));
    s.setEnd(0, at(kTop + kRadius + to));
    s.setStart(1, at(1.0));
    s.setEnd(1, at(1.0));
    std::vector<Contact> found;
    s.find(ContactSettings(), friction(), found);
    std::pair<int, int> upward_downward;
    for (const Contact& c : found) ++(c.normal.z() > 0 ? upward_downward.first : upward_downward.second);
    return upward_downward;
  };
  EXPECT_GT(normals(false, -kIn, 0.01).second, 0);
  EXPECT_EQ(normals(true, -kIn, 0.01).second, 0);
  // from outside it is hit
  EXPECT_GT(normals(true, 0.002, -0.002).first, 0);
  EXPECT_EQ(normals(true, 0.002, -0.002).second, 0);
}

TEST(SurfaceContactsState, ObjectsBuiltAnewGoOnFromIt) {
  const std::vector<Motion> motion = motions();
  SurfaceContacts kept = surfaces();
  const std::vector<Step> steps = stepsOf(kept, motion);
  size_t contacts = 0, overlapping = 0, others_without_it = 0;
  for (size_t i = 1; i < motion.size(); ++i) {
    SurfaceContacts anew = surfaces(), without = surfaces();
    anew.restore(steps[i].state);
    EXPECT_TRUE(anew.state() == steps[i].state);
    expectSame(found(anew, motion[i], steps[i - 1].contacts), steps[i].contacts, i);
    EXPECT_EQ(anew.overlap(), steps[i].overlap);
    if (i + 1 < motion.size()) {
      EXPECT_TRUE(anew.state() == steps[i + 1].state) << "step " << i;
    }
    others_without_it += found(without, motion[i], steps[i - 1].contacts) == steps[i].contacts ? 0 : 1;
    contacts += steps[i].contacts.size();
    overlapping += steps[i].overlap > 0 ? 1 : 0;
  }
  EXPECT_GT(contacts, 300u);
  EXPECT_GT(overlapping, 2u);
  EXPECT_GT(others_without_it, 0u) << "the state makes no difference here: nothing was tested";
}

TEST(SurfaceContactsState, FrontsOfSearchesElsewhereStay) {
  const std::vector<Motion> motion = motions();
  SurfaceContacts kept = surfaces();
  const std::vector<Step> steps = stepsOf(kept, motion);
  for (const size_t back : {35u, 20u, 3u, 31u, 8u}) {
    kept.restore(steps[back].state);
    for (size_t i = back; i < back + 4; ++i) {
      expectSame(found(kept, motion[i], steps[i - 1].contacts), steps[i].contacts, i);
      EXPECT_EQ(kept.overlap(), steps[i].overlap);
    }
  }
}

TEST(SurfaceContactsState, AskedToRecheckTheySeeWhatWasSetFromOutside) {
  const std::vector<Motion> motion = motions();
  SurfaceContacts s = surfaces();
  stepsOf(s, {motion.begin(), motion.begin() + kSqueezed});
  found(s, motion[kSqueezed], {});
  EXPECT_EQ(s.overlap(), 0.0);  // not looked for
  s.recheckOverlaps();
  found(s, motion[kSqueezed], {});
  EXPECT_GT(s.overlap(), 5e-4);  // a millimeter, less what nodes and slide take off
}

// What is given up depends on what all searches together cost, and the next search misses nothing for it.
TEST(SurfaceContactsBudget, GivenUpWhereAllSearchesTogetherCostMore) {
  const Motion motion = motions()[10];
  struct Search {
    std::vector<Contact> contacts;
    double operations;
    bool gave_up;
  };
  const auto search = [&](SurfaceContacts& s, double allowed) {
    for (int b = 0; b < 2; ++b) s.setStart(b, motion.start[static_cast<size_t>(b)]);
    for (int b = 0; b < 2; ++b) s.setEnd(b, motion.end[static_cast<size_t>(b)]);
    Search out;
    s.allow(allowed);
    s.find(ContactSettings(), friction(), out.contacts);
    out.operations = s.operations();
    out.gave_up = s.gaveUp();
    return out;
  };
  constexpr double kNoLimit = std::numeric_limits<double>::infinity();
  SurfaceContacts whole = surfaces();
  const Search all = search(whole, kNoLimit);
  EXPECT_FALSE(all.gave_up);
  EXPECT_GT(all.contacts.size(), 10u);
  int selves_only = 0;
  for (const double share : {0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.9, 0.99, 1.01, 2.0}) {
    SurfaceContacts s = surfaces();
    const Search limited = search(s, share * all.operations);
    EXPECT_EQ(limited.gave_up, share < 1) << share;
    selves_only += limited.gave_up && limited.contacts.empty() ? 1 : 0;
    if (share >= 1) {
      EXPECT_EQ(limited.operations, all.operations);
      expectSame(limited.contacts, all.contacts, 0);
    }
    const Search again = search(s, kNoLimit);
    EXPECT_FALSE(again.gave_up);
    expectSame(again.contacts, all.contacts, 0);
  }
  EXPECT_GT(selves_only, 0) << "no search of a surface by itself was given up";
  EXPECT_LT(selves_only, 8) << "no search of a pair was given up";
}

TEST(SurfaceContactsState, OfOtherSurfacesIsRejected) {
  SurfaceContacts s = surfaces();
  SurfaceContactsState state = s.state();
  EXPECT_EQ(state.may_overlap.size(), 3u);
  state.may_overlap.pop_back();
  EXPECT_THROW(s.restore(state), std::invalid_argument);
}

}  // namespace
}  // namespace palpate
