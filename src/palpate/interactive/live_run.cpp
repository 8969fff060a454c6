#include "palpate/interactive/live_run.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <ctime>
#include <deque>
#include <fstream>
#include <limits>
#include <mutex>
#include <thread>

#include "palpate/common/error.h"
#include "palpate/common/overloaded.h"
#include "palpate/common/parallel.h"
#include "palpate/interactive/recorder.h"
#include "palpate/protocol/commands.h"
#include "palpate/results/run_files.h"
#include "palpate/scene/method.h"
#include "palpate/scene/overrides.h"
#include "palpate/session/realtime_loops.h"

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::microseconds kPumpPeriod{16667};
constexpr std::chrono::milliseconds kStatsPeriod{500};
constexpr std::chrono::seconds kHandIdle{2};  // after which another viewer may take the hand
constexpr std::size_t kMostTasks = 1000;      // a flood of messages is cut off here
constexpr double kRecordedPlot = 300.0;       // length of a recording that its report's plots are made for [s]

Bytes share(std::string text) { return std::make_shared<const std::string>(std::move(text)); }

double threadSeconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// The moduli of all bodies times a factor.
SceneConfig stiffened(SceneConfig config, double factor) {
  const auto scale = [factor](MaterialConfig& m) {
    m.youngs_modulus *= factor;
    for (MaterialPartConfig& part : m.parts) part.youngs_modulus *= factor;
  };
  scale(config.tool.material);
  for (FreeBodyConfig& b : config.bodies) scale(b.material);
  return config;
}

// One scene, built and running: everything that a reset or another scene replaces.
class Stage {
 public:
  Stage(const SceneConfig& config, const LiveSettings& settings, std::uint32_t generation)
      : config_(config),
        scene_(buildScene(stiffened(config, settings.stiffness))),
        mouse_(replaceDevice()),
        reader_(scene_.world),
        encoder_(scene_.world.link, scene_.haptic.proxy.mass * scene_.haptic.proxy.gravity, generation),
        stress_(settings.stress),
        loops_((scene_.world.setFrictionScale(settings.friction), scene_), timingOf(config),
               [this](const World& world, const VisualRecord& record) { stepped(world, record); }) {
    last_tick_.device.pose = scene_.start;
    last_tick_.proxy = scene_.world.tool().state.handle.pose;
    keepState();
  }

  const SceneConfig& config() const { return config_; }
  const BuiltScene& scene() const { return scene_; }
  RealtimeLoops& loops() { return loops_; }
  const TickRecord& lastTick() const { return last_tick_; }
  MouseDevice& mouse() { return mouse_; }
  void setStress(bool on) { stress_.store(on); }

  // The following while the loops stand still.
  void setMethod(const SceneConfig& config) {
    config_ = config;
    scene_.linearization.delassus = delassusOf(config.method);
    loops_.change(renderingOf(config.method), timingOf(config));
  }
  void setFriction(double scale) { scene_.world.setFrictionScale(scale); }
  void setStiffness(double scale) {
    for (int i = 0; i < scene_.world.bodies(); ++i) {
      if (!scene_.world.body(i).model.isRigid()) scene_.world.setStiffnessScale(i, scale);
    }
  }
  void record(Recorder* recorder, RunSink sink) {
    recorder_ = recorder;
    sink_ = std::move(sink);
  }

  // Takes rows and states from the loops and hands them on.
  void pump(Audience& audience, std::uint32_t generation, bool again) {
    VisualRecord step;
    while (loops_.pop(step)) {
      encoder_.add(step, loops_.substeps());
      sink_.visual(step);
      if (recorder_) recorder_->step(step, loops_.substeps());
    }
    TickRecord tick;
    bool ticked = again;
    while (loops_.pop(tick)) {
      encoder_.add(tick);
      sink_.tick(tick);
      if (recorder_) recorder_->tick(tick);
      last_tick_ = tick;
      ticked = true;
    }
    if (!encoder_.empty()) {
      const auto ticks = static_cast<std::uint32_t>(encoder_.ticks());
      audience.samples(share(encoder_.take()), ticks);
    }
    const SceneState* state = states_.read();
    if (state == nullptr || !ticked) return;
    if (!full_ || state->step != full_step_ || again) {
      full_ = share(frameMessage(*state, last_tick_, mouse_.taken(), generation, true));
      full_step_ = state->step;
    }
    audience.frame(state->step, full_, share(frameMessage(*state, last_tick_, mouse_.taken(), generation, false)));
  }

 private:
  MouseDevice& replaceDevice() {
    auto mouse = buildMouse(config_, scene_.start);
    MouseDevice& out = *mouse;
    scene_.device = std::move(mouse);
    return out;
  }

  // On the visual loop's thread, or while it stands still.
  void stepped(const World& world, const VisualRecord& record) {
    ++state_.step;
    keepState();
    if (recorder_) recorder_->state(world, record);
  }
  void keepState() {
    reader_.read(scene_.world, config_.visual_step, stress_.load(std::memory_order_relaxed), state_);
    states_.write(state_);
  }

  SceneConfig config_;
  BuiltScene scene_;
  MouseDevice& mouse_;
  StateReader reader_;
  SampleEncoder encoder_;
  std::atomic<bool> stress_;
  SceneState state_;
  LatestValue<SceneState> states_;
  TickRecord last_tick_;
  Bytes full_;
  std::uint32_t full_step_ = 0;
  Recorder* recorder_ = nullptr;
  RunSink sink_;
  RealtimeLoops loops_;  // last: its threads use all of the above
};

}  // namespace

struct LiveRun::Impl {
  Impl(SceneConfig first, LiveOptions live_options, Audience& viewers)
      : base(std::move(first)), options(std::move(live_options)), audience(viewers) {}

  // --- the pump's thread

  void run() {
    auto next = Clock::now();
    auto stats = next;
    std::unique_lock lock(mutex);
    while (!stopping) {
      wake.wait_until(lock, next, [&] { return stopping || !tasks.empty(); });
      std::deque<std::function<void()>> todo;
      todo.swap(tasks);
      lock.unlock();
      for (const auto& task : todo) attempt(task);
      if (Clock::now() >= next) {
        attempt([&] { pump(false); });
        next = std::max(next + kPumpPeriod, Clock::now());
      }
      if (Clock::now() >= stats) {
        attempt([&] { publishStats(); });
        stats = Clock::now() + kStatsPeriod;
      }
      lock.lock();
    }
    lock.unlock();
    attempt([&] {
      stage->loops().stop();
      pump(false);
      endRecording();
    });
  }

  // What goes wrong is told to the viewers; the run goes on.
  void attempt(const std::function<void()>& work) {
    try {
      work();
    } catch (const std::exception& e) {
      notice(true, e.what());
    }
  }

  void pump(bool again) {
    if (stage->loops().started() && stage->loops().ended()) {
      settings.paused = true;
      publishState();
      stage->loops().stop();  // throws what ended them
    }
    stage->pump(audience, generation, again);
  }

  void go() {
    if (!settings.paused) stage->loops().start(settings.speed, std::numeric_limits<double>::infinity());
  }

  void halt() { stage->loops().stop(); }

  // Builds a scene in place of the present one, which goes on if that fails.
  void load(const SceneConfig& config, const std::string& busy) {
    if (stage) {
      status.busy = busy;
      publishState();
      halt();
      pump(false);
    }
    try {
      auto next = std::make_unique<Stage>(config, settings, generation + 1);
      if (stage) endRecording();
      stage = std::move(next);
    } catch (...) {
      status.busy.clear();
      if (stage) {
        publishState();
        go();
      }
      throw;
    }
    base = config;
    ++generation;
    status.busy.clear();
    command = {};
    status.hand.reset();
    status.on_path = true;
    greet();
    publishState();
    pump(true);
    go();
  }

  void greet() {
    audience.greet({{false, share(sceneMessage(stage->config(), stage->scene(), options.scenes, generation))},
                    {true, share(geometryMessage(stage->scene().world, generation))}});
  }

  void publishState() { audience.state(share(stateMessage(stage->config(), settings, status, generation))); }

  void notice(bool error, const std::string& text) { audience.text(share(noticeMessage(error, text))); }

  void publishStats() {
    const PeriodicReport& report = stage->loops().report();
    const auto now = Clock::now();
    const double cpu = threadSeconds() + audience.cpuSeconds();
    const double wall = std::chrono::duration<double>(now - stats_time).count();
    LiveFigures f;
    f.ticks = report.ticks;
    f.missed = report.missed;
    f.dropped = stage->loops().dropped();
    f.delivered_energy = stage->lastTick().delivered_energy;
    f.realtime_note = stage->loops().realtimeNote();
    f.server_share = wall > 0 ? (cpu - stats_cpu) / wall : 0.0;
    stats_time = now;
    stats_cpu = cpu;
    audience.text(share(statsMessage(f, report)));
  }

  // --- commands

  void obey(int viewer, const ViewerCommand& message) {
    std::visit(
        Overloaded{[&](const HandMessage& m) { moveHand(viewer, m); }, [&](const TakeMessage&) { takeHand(viewer); },
                   [&](const ReleaseMessage&) { releaseHand(viewer); }, [&](const PlayMessage&) { play(); },
                   [&](const SetMessage& m) { set(m); }, [&](const PauseMessage&) { pause(true); },
                   [&](const ResumeMessage&) { pause(false); }, [&](const StepMessage&) { singleStep(); },
                   [&](const ResetMessage&) { load(base, "back to the start"); },
                   [&](const SceneMessage& m) { openScene(m.name); }, [&](const RecordMessage& m) { record(m.on); }},
        message);
  }

  void moveHand(int viewer, const HandMessage& m) {
    if (status.hand != viewer) return;
    hand_moved = Clock::now();
    command.driver = HandCommand::Driver::hand;
    command.pose = m.pose;
    command.sequence = m.sequence;
    stage->mouse().command(command);
  }

  void takeHand(int viewer) {
    if (status.hand && *status.hand != viewer && Clock::now() - hand_moved < kHandIdle) {
      audience.textTo(viewer, share(noticeMessage(false, "somebody else holds the tool")));
      return;
    }
    status.hand = viewer;
    status.on_path = false;
    hand_moved = Clock::now();
    command.driver = HandCommand::Driver::hand;
    command.pose = stage->lastTick().device.pose;
    stage->mouse().command(command);
    publishState();
  }

  void releaseHand(int viewer) {
    if (status.hand != viewer) return;
    status.hand.reset();
    publishState();
  }

  void play() {
    status.hand.reset();
    status.on_path = true;
    command.driver = HandCommand::Driver::path;
    ++command.plays;
    stage->mouse().command(command);
    publishState();
  }

  void set(const SetMessage& m) {
    SceneConfig wanted = stage->config();
    Overrides overrides;
    overrides.method = m.method;
    overrides.handle = m.handle;
    if (m.visual_step) {
      const double ticks = std::round(*m.visual_step / wanted.haptic_step);
      overrides.visual_dt = ticks * wanted.haptic_step;
    }
    applyOverrides(wanted, overrides);
    if (m.speed) settings.speed = *m.speed;
    if (m.stress) {
      settings.stress = *m.stress;
      stage->setStress(*m.stress);
    }
    if (wanted.tool.handle != stage->config().tool.handle) {
      if (m.friction) settings.friction = *m.friction;
      if (m.stiffness) settings.stiffness = *m.stiffness;
      load(wanted, "held by " + wanted.tool.handle);
      return;
    }
    halt();
    stage->setMethod(wanted);
    base = wanted;
    if (m.friction) stage->setFriction(settings.friction = *m.friction);
    if (m.stiffness) {
      settings.stiffness = *m.stiffness;
      stage->setStiffness(settings.stiffness);
    }
    publishState();
    go();
  }

  void pause(bool on) {
    settings.paused = on;
    if (on) {
      halt();
      pump(true);
    } else {
      go();
    }
    publishState();
  }

  void singleStep() {
    if (!settings.paused) pause(true);
    stage->loops().stepOnce();
    pump(true);
  }

  void openScene(const std::string& name) {
    const auto found =
        std::find_if(options.scenes.begin(), options.scenes.end(), [&](const SceneEntry& s) { return s.name == name; });
    if (found == options.scenes.end()) throw InputError("scene", name, "is none of those to choose from");
    load(options.open(*found), "opening " + name);
  }

  void record(bool on) {
    if (on == (files != nullptr)) return;
    halt();
    pump(false);
    if (on) {
      beginRecording();
    } else {
      endRecording();
    }
    publishState();
    go();
  }

  // Both while the loops stand still.
  void beginRecording() {
    const std::time_t now = std::time(nullptr);
    const auto folder =
        options.record_folder / fmt::format("{}-{:%Y%m%d-%H%M%S}", stage->config().name, fmt::localtime(now));
    SceneConfig config = stage->config();
    config.duration = kRecordedPlot;
    files = std::make_unique<RunFiles>(folder, config);
    recorder = std::make_unique<Recorder>(files->stage("recording.palpate"), config, stage->scene(), settings);
    stage->record(recorder.get(), files->sink());
    status.recording = folder.string();
  }

  void endRecording() {
    if (!files) return;
    stage->record(nullptr, {});
    const auto done = std::move(files);
    const auto frames = std::move(recorder);
    const std::string folder = std::exchange(status.recording, {});
    frames->finish();
    done->finish(stage->scene(), stage->loops().outcome(), nullptr);
    notice(false, "recorded in " + folder);
  }

  SceneConfig base;  // as it would be begun anew
  LiveOptions options;
  Audience& audience;
  LiveSettings settings;
  LiveStatus status;
  HandCommand command;
  std::unique_ptr<Stage> stage;
  std::unique_ptr<RunFiles> files;
  std::unique_ptr<Recorder> recorder;
  std::uint32_t generation = 0;
  Clock::time_point hand_moved{};
  Clock::time_point stats_time = Clock::now();
  double stats_cpu = 0;
  std::atomic<int> surfaces{0};

  // --- shared with the callers' threads
  std::mutex mutex;
  std::condition_variable wake;
  std::deque<std::function<void()>> tasks;
  bool stopping = false;
  std::thread thread;

  void post(std::function<void()> task, bool may_be_lost = false) {
    {
      const std::lock_guard lock(mutex);
      if (stopping || (may_be_lost && tasks.size() >= kMostTasks)) return;
      tasks.push_back(std::move(task));
    }
    wake.notify_one();
  }
};

LiveRun::LiveRun(SceneConfig config, LiveOptions options, Audience& audience)
    : impl_(std::make_unique<Impl>(std::move(config), std::move(options), audience)) {}

LiveRun::~LiveRun() { stop(); }

void LiveRun::start() {
  impl_->load(impl_->base, "");
  if (impl_->options.record_from_start) impl_->record(true);
  impl_->thread = std::thread([this, executor = Executor::current()] {
    const ExecutorScope scope(executor);
    impl_->run();
  });
}

void LiveRun::stop() {
  {
    const std::lock_guard lock(impl_->mutex);
    impl_->stopping = true;
  }
  impl_->wake.notify_one();
  if (impl_->thread.joinable()) impl_->thread.join();
}

void LiveRun::joined(int) {
  impl_->post([i = impl_.get()] {
    ++i->status.viewers;
    i->publishState();
    i->pump(true);
  });
}

void LiveRun::left(int viewer) {
  impl_->post([i = impl_.get(), viewer] {
    --i->status.viewers;
    i->releaseHand(viewer);
    i->publishState();
  });
}

void LiveRun::message(int viewer, std::string_view json) {
  try {
    impl_->post(
        [i = impl_.get(), viewer, command = parseCommand(json)] {
          try {
            i->obey(viewer, command);
          } catch (const InputError& e) {
            i->audience.textTo(viewer, share(noticeMessage(true, e.what())));
          }
        },
        true);
  } catch (const InputError& e) {
    impl_->audience.textTo(viewer, share(noticeMessage(true, e.what())));
  }
}

std::optional<std::string> LiveRun::surface(const std::string& name, std::string&& content) {
  const auto folder = impl_->options.surface_folder / std::to_string(++impl_->surfaces);
  const auto file = folder / name;
  try {
    std::filesystem::create_directories(folder);
    std::ofstream out(file, std::ios::binary);
    out << content;
    out.close();
    if (!out) return "the file could not be kept";
  } catch (const std::exception& e) {
    return std::string("the file could not be kept: ") + e.what();
  }
  impl_->post([i = impl_.get(), file, name] { i->load(sceneOfSurface(file, name), "making " + name + " soft"); });
  return std::nullopt;
}

}  // namespace palpate
