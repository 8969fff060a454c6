#include "palpate/study/stress.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/mesh/surface_measures.h"
#include "palpate/results/statistics.h"
#include "palpate/session/lockstep.h"
#include "palpate/session/realtime_loops.h"
#include "palpate/study/examiner.h"
#include "palpate/study/freeze_watch.h"

namespace palpate {
namespace {

constexpr double kInside = 1e-4;  // of the tool's diagonal: a vertex less deep is on the surface, not on the wrong side
constexpr double kRounding = 1.01;                       // of contact's own tolerance, at which a vertex may rest
constexpr double kDeepest = 1e-3;                        // of the diagonal
constexpr double kCutShare = 1e-3;                       // of all steps
constexpr double kEnergyMade = 5e-4;                     // in one step [J]
constexpr double kLastSecond = 1.0;                      // of a ride [s]
constexpr double kHandleOff = 5e-4;                      // [m]
constexpr double kEnergyOff = 1e-4, kEnergyShare = 0.1;  // [J], of the energy

enum class Touch { nothing, itself, others };

// What the tool, or what is glued to it, touches, by the last step's contacts. A rigid body that nobody holds, glued to
// them, may lie anywhere: it counts as touched.
Touch touchOf(const World& world) {
  const ContactSet& set = world.contacts();
  const std::vector<int> own = world.gluedTogether(world.toolIndex());
  const auto isOwn = [&](int body) { return std::find(own.begin(), own.end(), body) != own.end(); };
  for (const Joint& joint : world.joints()) {
    if (isOwn(joint.body) != isOwn(joint.partner)) return Touch::others;
  }
  Touch out = Touch::nothing;
  for (std::size_t c = 0; c < set.contacts.size(); ++c) {
    if (set.contacts[c].glued() || set.status[c].state == ContactState::open) continue;
    const int a = set.contacts[c].first.body, b = set.contacts[c].second.body;
    if (a != b && (isOwn(a) || isOwn(b))) return Touch::others;
    if (isOwn(a)) out = Touch::itself;
  }
  return out;
}

// Whether the world moves the tool, or what is glued to it: then nothing comes to rest.
bool drivesTool(const World& world) {
  const std::vector<int> own = world.gluedTogether(world.toolIndex());
  return std::any_of(own.begin(), own.end(), [&](int i) { return world.body(i).model.driven(); });
}

/// Where a world has come to rest.
struct Rest {
  Pose handle;
  double energy = 0;  // elastic, of the tool [J]
};

Rest restOf(const World& world) {
  const Body tool = world.tool();
  ElasticAhead own;  // not the system's, which belongs to the next step
  return {tool.state.handle.pose, tool.model.elasticity().energyAt(tool.state.positions, tool.state.elastic, own)};
}

/// Goes evenly from one place of a hand's way to the next within a visual step; feels nothing.
class WayDevice final : public Device {
 public:
  WayDevice(const DeviceLimits& limits, const Pose& start, double step) : limits_(limits), step_(step) { place(start); }
  void place(const Pose& pose) {
    from_ = to_ = {pose, Vec6::Zero()};
    begin_ = 0;
  }
  /// @param arrival  when it is to be there [s]
  void goTo(const DeviceTarget& target, double arrival) {
    from_ = std::exchange(to_, target);
    begin_ = arrival - step_;
  }

  const char* name() const noexcept override { return "stress"; }
  DeviceLimits limits() const noexcept override { return limits_; }
  DeviceState sample(double t) noexcept override {
    const double share = (t - begin_) / step_;
    const DeviceTarget at = share < 1.0 - 1e-9 ? between(from_, to_, std::max(share, 0.0)) : to_;
    return {at.pose, at.twist, 0};
  }
  void apply(const Vec6& /*wrench*/, double /*t*/, double /*dt*/) noexcept override {}

 private:
  DeviceLimits limits_;
  double step_, begin_ = 0;
  DeviceTarget from_, to_;
};

/// Takes the steps and looks at the world after each.
class StressRun {
 public:
  StressRun(BuiltScene& scene, const StressSettings& settings, const std::function<bool(double)>& going_on)
      : scene_(scene),
        world_(scene.world),
        budget_(world_.budget),
        settings_(settings),
        going_on_(going_on),
        hand_(giveHand(scene, settings.timing.visual_step)),
        run_(scene, settings.timing, sink_),
        diagonal_(boundsOf(world_.tool().model.mesh().surface.vertices).diagonal()),
        driven_(drivesTool(world_)),
        examiner_(world_, std::max(kInside * diagonal_, kRounding * world_.contact.penetration_tolerance),
                  settings.crossable),
        freeze_(world_, scene.start, settings.timing.visual_step) {
    settings_.motion.step = settings.timing.visual_step;
    settings_.motion.reach = settings.reach * diagonal_;
    if (settings.by_clock) world_.budget.seconds = RealtimeLoops::stepBudget(settings.timing.visual_step);
    if (settings_.riding && settings_.rides == 0) {  // all rides are of about one length
      const int length = static_cast<int>(rideOf(scene.start, settings_.motion, settings_.seed).way.size());
      settings_.rides = (settings_.steps + length - 1) / length;
    }
  }

  StressRun(const StressRun&) = delete;
  StressRun& operator=(const StressRun&) = delete;
  ~StressRun() {
    std::swap(scene_.device, device_);
    world_.budget = budget_;
  }

  StressOutcome finish() {
    if (settings_.riding) {
      rideAll();
    } else {
      runWild();
    }
    outcome_.median_ms = percentile(times_, 0.5);
    outcome_.p99_ms = percentile(times_, 0.99);
    outcome_.p99_9_ms = percentile(times_, 0.999);
    outcome_.max_ms = percentile(times_, 1.0);
    return outcome_;
  }

 private:
  WayDevice& giveHand(BuiltScene& scene, double step) {
    auto hand = std::make_unique<WayDevice>(scene.device->limits(), scene.start, step);
    WayDevice& out = *hand;
    device_ = std::exchange(scene.device, std::move(hand));
    sink_.visual = [this](const VisualRecord& record) { record_ = record; };
    return out;
  }

  void runWild() {
    WildHand hand(scene_.start, settings_.motion, settings_.seed);
    while (!outcome_.stopped && outcome_.all.steps < settings_.steps) {
      const StressBout bout = hand.bout(settings_.steps - outcome_.all.steps);
      const int last = static_cast<int>(bout.way.size()) - 1;
      for (int n = 0; n <= last && !outcome_.stopped; ++n) {
        const Examination seen = step(bout.way[n], outcome_.all);
        if (n == last) addCalm(seen, outcome_.all);
        report(static_cast<double>(outcome_.all.steps) / settings_.steps);
      }
    }
  }

  void rideAll() {
    built_ = run_.state();
    leaveAlone(static_cast<int>(std::ceil(settings_.motion.home / settings_.motion.step - 1e-9)));
    for (int k = 0; k < settings_.rides && !outcome_.stopped; ++k) {
      beginAnew();
      freeze_.restart(world_);
      cut_before_ = false;
      StressRide ride;
      ride.seed = settings_.seed + static_cast<std::uint64_t>(k);
      rideOne(ride, static_cast<double>(k));
      outcome_.all += ride.tally;
      outcome_.rides.push_back(ride);
    }
  }

  void beginAnew() {
    run_.restore(built_);
    hand_.place(scene_.start);
    steps_ = 0;
  }

  // The built scene after so many steps in which the hand stands still.
  void leaveAlone(int steps) {
    const std::size_t known = times_.size();
    beginAnew();
    for (int n = 0; n < steps; ++n) take({scene_.start, Vec6::Zero()});
    reference_ = restOf(world_);
    reference_touch_ = touchOf(world_);
    times_.resize(known);
  }

  void rideOne(StressRide& ride, double before) {
    const StressBout bout = rideOf(scene_.start, settings_.motion, ride.seed);
    const int steps = static_cast<int>(bout.way.size());
    const int last_second =
        steps - std::min(bout.calm, std::max(1, static_cast<int>(kLastSecond / settings_.motion.step)));
    StressTally calm;
    for (int n = 0; n < steps && !outcome_.stopped; ++n) {
      const StressTally until = ride.tally;
      const Examination seen = step(bout.way[n], ride.tally);
      ride.max_ms = std::max(ride.max_ms, times_.back());
      if (n >= last_second) {
        calm.wrong_side = std::max(calm.wrong_side, seen.wrong_side);
        calm.self_intersections = std::max(calm.self_intersections, seen.self_intersections);
        calm.inverted = std::max(calm.inverted, seen.inverted);
        if (ride.tally.cut > until.cut || ride.tally.not_converged > until.not_converged) ++calm.restless;
      }
      report((before + static_cast<double>(n + 1) / steps) / settings_.rides);
      if (n + 1 == steps) {
        ride.tally += calm;
        judge(ride);
      }
    }
  }

  // Handle and energy at a ride's end.
  void judge(StressRide& ride) {
    const Rest end = restOf(world_);
    const Touch touch = touchOf(world_);
    ride.energy = end.energy;
    if (!std::isfinite(end.energy)) {
      ride.came_back = false;
      return;
    }
    if (driven_ && touch != Touch::others) leaveAlone(static_cast<int>(steps_));  // where it is by now
    Rest wanted = reference_;
    bool same_energy = true;
    if (touch != Touch::others && reference_touch_ != Touch::others) {
      // a tool that touches only itself may lie otherwise than before, but its weight hangs from the handle
      ride.judge = RideJudge::reference;
      same_energy = touch == Touch::nothing;
    } else if (settings_.solve_static && settle()) {
      wanted = restOf(world_);
      ride.judge = RideJudge::settled;
    }
    ride.handle_off = (end.handle.position - wanted.handle.position).norm();
    ride.energy_off = end.energy - wanted.energy;
    const bool same = sameEnergy(end, wanted) || !same_energy;
    if (!same && ride.judge == RideJudge::reference && settings_.solve_static && !driven_ && swings()) {
      ride.judge = RideJudge::swings;
    }
    ride.came_back =
        ride.judge == RideJudge::none || (ride.handle_off <= kHandleOff && (same || ride.judge == RideJudge::swings));
  }

  static bool sameEnergy(const Rest& a, const Rest& wanted) {
    return std::abs(a.energy - wanted.energy) <= kEnergyOff + kEnergyShare * wanted.energy;
  }

  // To the static solution from the present state. @returns whether there is one: friction may let go now and then
  bool settle() {
    try {
      world_.settle(world_.gluedTogether(world_.toolIndex()), scene_.start);
    } catch (const RunError&) {
      return false;
    }
    return true;
  }

  // Whether the tool only swings: at rest it would hang as the built scene does.
  bool swings() {
    if (!settle()) return false;
    const Rest still = restOf(world_);
    beginAnew();
    if (!settle()) return false;
    const Rest built = restOf(world_);
    return sameEnergy(still, built) && (still.handle.position - built.handle.position).norm() <= kHandleOff;
  }

  // A visual step of a run, and the ticks on the way to it.
  StepReport take(const DeviceTarget& device) {
    const RunTiming& timing = settings_.timing;
    const auto ticks = steps_ * std::llround(timing.visual_step / timing.haptic_step);
    hand_.goTo(device, static_cast<double>(ticks) * timing.haptic_step);
    run_.runUntil(ticks + 1);
    times_.push_back(1e3 * (record_.step.times.total() + record_.linearization_s));
    ++steps_;
    return record_.step;
  }

  Examination step(const DeviceTarget& device, StressTally& tally) {
    addReport(take(device), tally);
    const Examination seen = examiner_.examine(world_);
    if (!seen.finite) ++tally.nan;
    tally.deepest_penetration_rel = std::max(tally.deepest_penetration_rel, seen.depth / diagonal_);
    tally.crossed += seen.self_intersections > 0 ? 1 : 0;
    tally.passed += seen.passed > 0 ? 1 : 0;
    tally.folded += seen.inverted > 0 ? 1 : 0;
    // what holds the tool holds the handle back as a touch does
    const bool touches = !world_.tool().model.attachments().empty() || touchOf(world_) == Touch::others;
    tally.frozen += freeze_.after(world_, device.pose, touches, cut_before_) > 0 ? 1 : 0;
    return seen;
  }

  void addReport(const StepReport& report, StressTally& tally) {
    ++tally.steps;
    tally.restored += report.status == StepStatus::restored ? 1 : 0;
    tally.not_converged += report.status == StepStatus::contact_not_converged ? 1 : 0;
    const bool cut = report.motion_share < 1;
    tally.cut += cut ? 1 : 0;
    tally.cut_twice += cut && cut_before_ ? 1 : 0;
    cut_before_ = cut;
    tally.least_share = std::min(tally.least_share, report.motion_share);
    tally.redone += report.redone > 0 ? 1 : 0;
    tally.energy_made += report.energy_made;
    tally.largest_energy_made = std::max(tally.largest_energy_made, report.energy_made);
    tally.max_kinetic = std::max(tally.max_kinetic, report.kinetic_energy);
    tally.max_elastic = std::max(tally.max_elastic, report.elastic_energy);
    tally.max_energy = std::max(tally.max_energy, report.kinetic_energy + report.elastic_energy);
  }

  static void addCalm(const Examination& seen, StressTally& tally) {
    tally.wrong_side += seen.wrong_side;
    tally.self_intersections += seen.self_intersections;
    tally.inverted += seen.inverted;
  }

  void report(double share) {
    if (going_on_ && !going_on_(share)) outcome_.stopped = true;
  }

  BuiltScene& scene_;
  World& world_;
  const StepBudget budget_;  // the scene's own
  StressSettings settings_;
  const std::function<bool(double)>& going_on_;
  std::unique_ptr<Device> device_;  // the scene's own
  RunSink sink_;
  VisualRecord record_;  // of the last step
  WayDevice& hand_;
  LockstepRun run_;
  double diagonal_;
  bool driven_;
  LockstepState built_;
  Examiner examiner_;
  FreezeWatch freeze_;
  Rest reference_;
  Touch reference_touch_ = Touch::nothing;
  bool cut_before_ = false;
  std::int64_t steps_ = 0;
  std::vector<double> times_;  // [ms]
  StressOutcome outcome_;
};

// The criteria on steps, and after calm.
std::vector<std::string> failuresOf(const StressTally& t) {
  std::vector<std::string> out;
  const auto none = [&](int count, const char* what) {
    if (count > 0) out.push_back(fmt::format("{} {}", count, what));
  };
  none(t.nan, "steps not finite");
  none(t.restored, "steps restored");
  if (t.deepest_penetration_rel > kDeepest) {
    out.push_back(fmt::format("penetration of {:.3f} % of the tool's diagonal", 100 * t.deepest_penetration_rel));
  }
  none(t.wrong_side, "vertices on the wrong side after calm");
  none(t.self_intersections, "pairs of triangles of one body intersect after calm");
  none(t.inverted, "inverted tetrahedra after calm");
  none(t.frozen, "steps with a frozen body");
  none(t.cut_twice, "steps cut short right after one cut short");
  none(t.restless, "steps cut short or not converged in the last second of a ride");
  if (t.largest_energy_made > kEnergyMade) {
    out.push_back(fmt::format("{:.3g} J made in one step", t.largest_energy_made));
  }
  return out;
}

}  // namespace

StressTally& StressTally::operator+=(const StressTally& o) {
  for (const auto sum : {&StressTally::steps, &StressTally::nan, &StressTally::restored, &StressTally::not_converged,
                         &StressTally::cut, &StressTally::cut_twice, &StressTally::redone, &StressTally::frozen,
                         &StressTally::crossed, &StressTally::passed, &StressTally::folded, &StressTally::wrong_side,
                         &StressTally::self_intersections, &StressTally::inverted, &StressTally::restless}) {
    this->*sum += o.*sum;
  }
  for (const auto most : {&StressTally::deepest_penetration_rel, &StressTally::max_energy, &StressTally::max_kinetic,
                          &StressTally::max_elastic, &StressTally::largest_energy_made}) {
    this->*most = std::max(this->*most, o.*most);
  }
  least_share = std::min(least_share, o.least_share);
  energy_made += o.energy_made;
  return *this;
}

bool StressRide::failed() const { return !came_back || !failuresOf(tally).empty(); }

StressOutcome runStress(BuiltScene& scene, const StressSettings& settings,
                        const std::function<bool(double)>& going_on) {
  return StressRun(scene, settings, going_on).finish();
}

std::vector<std::string> stressFailures(const StressOutcome& outcome) {
  std::vector<std::string> out = failuresOf(outcome.all);
  if (outcome.all.cut > kCutShare * outcome.all.steps) {
    out.push_back(fmt::format("{} of {} steps cut short", outcome.all.cut, outcome.all.steps));
  }
  const auto away =
      std::count_if(outcome.rides.begin(), outcome.rides.end(), [](const StressRide& ride) { return !ride.came_back; });
  if (away > 0)
    out.push_back(fmt::format("{} of {} rides did not come back to rest as they should", away, outcome.rides.size()));
  return out;
}

}  // namespace palpate
