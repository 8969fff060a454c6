#include "palpate/interactive/interactive_run.h"

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

#include "palpate/common/cancellation.h"
#include "palpate/common/error.h"
#include "palpate/common/overloaded.h"
#include "palpate/common/parallel.h"
#include "palpate/interactive/recorder.h"
#include "palpate/interactive/running_scene.h"
#include "palpate/interactive/surface_scene.h"
#include "palpate/mesh/surface_measures.h"
#include "palpate/protocol/commands.h"
#include "palpate/results/run_files.h"
#include "palpate/scene/overrides.h"
#include "palpate/scene/save.h"

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::microseconds kPumpPeriod{16667};
constexpr std::chrono::milliseconds kStatsPeriod{500};
constexpr std::chrono::seconds kHandIdle{2};  // after which another viewer may take the hand
constexpr std::size_t kMostTasks = 1000;      // a flood of messages is cut off here
constexpr int kMostLoads = 4;                 // scenes to be built that may wait
constexpr double kRecordedPlot = 300.0;       // length of a recording that its report's plots are made for [s]

Bytes share(std::string text) { return std::make_shared<const std::string>(std::move(text)); }

double threadSeconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// A dropped surface that is shown and does not run yet.
struct Placing {
  std::filesystem::path file;
  std::string name;
  SurfacePreview preview;
  SceneConfig before;  ///< what ran until it came
};

/// Whether a message makes sense while a surface waits to be placed.
bool isForPlacing(const ViewerCommand& message) {
  return std::holds_alternative<PlaceMessage>(message) || std::holds_alternative<CancelMessage>(message) ||
         std::holds_alternative<SceneMessage>(message) || std::holds_alternative<ReleaseMessage>(message);
}

/// What a person wants to know of a surface that has become a tool.
std::string describePlaced(const BuiltScene& scene) {
  const BodyModel& tool = scene.world.tool().model;
  const Bounds box = boundsOf(tool.mesh().surface.vertices);
  const Vec3 mm = 1e3 * (box.high - box.low);
  return fmt::format("{} tetrahedra, {} nodes, {} of them in the handle; {:.4g} x {:.4g} x {:.4g} mm, {:.3g} kg",
                     scene.tetrahedra, scene.nodes, tool.handle().nodes.size(), mm.x(), mm.y(), mm.z(),
                     tool.totalMass());
}

/// What the pump has to do.
struct Task {
  std::function<void()> work;
  std::string load{};        ///< what scene is built by it; empty: none
  bool replaceable = false;  ///< the same load once more makes it needless
  bool records = false;      ///< begins or ends a recording: what was asked before it counts
};

// Of a message: all but the work.
Task taskOf(const ViewerCommand& command) {
  Task out;
  if (std::holds_alternative<ResetMessage>(command)) out.load = "reset";
  if (const auto* scene = std::get_if<SceneMessage>(&command)) out.load = "scene " + scene->name;
  out.replaceable = !out.load.empty();
  if (const auto* set = std::get_if<SetMessage>(&command); set && set->handle) out.load = "handle";
  if (std::holds_alternative<PlaceMessage>(command)) out.load = "place";
  out.records = std::holds_alternative<RecordMessage>(command);
  return out;
}

}  // namespace

struct InteractiveRun::Impl {
  Impl(SceneConfig first, InteractiveOptions interactive_options, Audience& viewers)
      : base(std::move(first)), options(std::move(interactive_options)), audience(viewers) {}

  // --- the pump's thread

  void run() {
    const CancellationScope cancel(&stopping);
    auto next = Clock::now();
    auto stats = next;
    std::unique_lock lock(mutex);
    while (!stopping) {
      wake.wait_until(lock, next, [&] { return stopping || !tasks.empty(); });
      if (stopping) break;
      Task task;
      if (!tasks.empty()) {  // one at a time: frames go on between them
        task = std::move(tasks.front());
        tasks.pop_front();
      }
      lock.unlock();
      if (task.work) attempt(task.work);
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
    attempt([&] { scene->loops().stop(RealtimeLoops::Ending::leaves); });
    attempt([&] { scene->pump(audience, generation, false); });
    endRecording("end of the program");
  }

  // What goes wrong is told to the viewers; the run goes on.
  void attempt(const std::function<void()>& work) {
    try {
      work();
    } catch (const Cancelled&) {  // nobody waits for it any more
    } catch (const std::exception& e) {
      notice(true, e.what());
    }
  }

  void pump(bool again) {
    if (scene->loops().started() && scene->loops().ended()) {
      settings.paused = true;
      publishState();
      scene->loops().stop();  // throws what ended them
    }
    scene->pump(audience, generation, again);
    if (const char* why = scene->scene().device->failure(); why != nullptr && why != told_failure) {
      told_failure = why;
      notice(true, std::string("the device is lost: ") + why);
    }
    watchMotion();
    if (!files || recordingFailure().empty()) return;
    const bool running = scene->loops().started();
    scene->loops().stop();
    endRecording("failure");
    publishState();
    if (running) startLoops();
  }

  // A path that has come to its end: whoever opens the page later sees nothing move.
  void watchMotion() {
    if (status.motion != Motion::playing) return;
    if (scene->lastTick().time < path_start + scene->config().tool.chosenHandle().hand.keyframes.back().time) return;
    status.motion = Motion::over;
    publishState();
  }

  void startLoops() {
    if (!settings.paused && !placing) scene->loops().start(settings.speed, std::numeric_limits<double>::infinity());
  }

  void stopLoops() { scene->loops().stop(); }

  // Builds a scene in place of the present one, which goes on if that fails.
  void load(const SceneConfig& config, const std::string& busy, std::optional<Placing> next_placing = std::nullopt) {
    if (scene) {
      status.busy = busy;
      publishState();
      stopLoops();
      pump(false);
    }
    try {
      auto next = std::make_unique<RunningScene>(config, settings, generation + 1);
      endRecording("another scene");
      scene = std::move(next);
    } catch (...) {
      status.busy.clear();
      if (scene) {
        publishState();
        if (!stopping) startLoops();
      }
      throw;
    }
    base = config;
    placing = std::move(next_placing);
    status.placing = placing ? std::optional(placing->preview) : std::nullopt;
    ++generation;
    status.busy.clear();
    command = {};
    status.hand.reset();
    status.on_path = true;
    path_start = 0;
    status.motion = config.tool.chosenHandle().hand.keyframes.empty() ? Motion::none : Motion::playing;
    announceScene();
    publishState();
    pump(true);
    startLoops();
  }

  void announceScene() {
    audience.greet({{false, share(sceneMessage(scene->config(), scene->scene(), options.scenes, generation))},
                    {true, share(geometryMessage(scene->scene().world, generation))}});
  }

  void publishState() { audience.state(share(stateMessage(scene->config(), settings, status, generation))); }

  void notice(bool error, const std::string& text) { audience.text(share(noticeMessage(error, text))); }

  void publishStats() {
    const PeriodicReport& report = scene->loops().report();
    const auto now = Clock::now();
    const double cpu = threadSeconds() + audience.cpuSeconds();
    const double wall = std::chrono::duration<double>(now - stats_time).count();
    LoopFigures f;
    f.ticks = report.ticks;
    f.missed = report.missed;
    f.dropped = scene->loops().dropped();
    f.delivered_energy = scene->lastTick().delivered_energy;
    f.realtime_note = scene->loops().realtimeNote();
    f.server_share = wall > 0 ? (cpu - stats_cpu) / wall : 0.0;
    stats_time = now;
    stats_cpu = cpu;
    audience.text(share(statsMessage(f, report)));
  }

  // --- commands

  void carryOut(int viewer, const ViewerCommand& message) {
    if (placing && !isForPlacing(message))
      throw InputError("message", placing->name, "waits to be placed; start or cancel it first");
    std::visit(
        Overloaded{[&](const HandMessage& m) { moveHand(viewer, m); }, [&](const TakeMessage&) { takeHand(viewer); },
                   [&](const ReleaseMessage&) { releaseHand(viewer); }, [&](const PlayMessage&) { play(); },
                   [&](const SetMessage& m) { set(m); }, [&](const PauseMessage&) { pause(true); },
                   [&](const ResumeMessage&) { pause(false); }, [&](const StepMessage&) { singleStep(); },
                   [&](const ResetMessage&) { load(base, "back to the start"); },
                   [&](const SceneMessage& m) { openScene(m.name); }, [&](const RecordMessage& m) { record(m.on); },
                   [&](const PlaceMessage& m) { place(m); }, [&](const CancelMessage&) { cancelPlacing(); },
                   [&](const SaveMessage&) { save(viewer); }},
        message);
  }

  void moveHand(int viewer, const HandMessage& m) {
    if (status.hand != viewer) return;
    hand_moved = Clock::now();
    command.driver = HandCommand::Driver::hand;
    command.pose = m.pose;
    command.sequence = m.sequence;
    scene->mouse().command(command);
  }

  void takeHand(int viewer) {
    if (status.hand && *status.hand != viewer && Clock::now() - hand_moved < kHandIdle) {
      audience.textTo(viewer, share(noticeMessage(false, "somebody else holds the tool")));
      return;
    }
    status.hand = viewer;
    status.on_path = false;
    if (status.motion == Motion::playing) status.motion = Motion::over;
    hand_moved = Clock::now();
    command.driver = HandCommand::Driver::hand;
    command.pose = scene->lastTick().device.pose;
    scene->mouse().command(command);
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
    scene->mouse().command(command);
    path_start = scene->lastTick().time;
    if (status.motion != Motion::none) status.motion = Motion::playing;
    publishState();
  }

  void set(const SetMessage& m) {
    SceneConfig wanted = scene->config();
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
      scene->setStress(*m.stress);
    }
    if (wanted.tool.handle != scene->config().tool.handle) {
      if (m.friction) settings.friction = *m.friction;
      if (m.stiffness) settings.stiffness = *m.stiffness;
      load(wanted, "held by " + wanted.tool.handle);
      return;
    }
    stopLoops();
    scene->setMethod(wanted);
    base = wanted;
    if (m.friction) scene->setFriction(settings.friction = *m.friction);
    if (m.stiffness) scene->setStiffness(settings.stiffness = *m.stiffness);
    publishState();
    startLoops();
  }

  void pause(bool on) {
    settings.paused = on;
    if (on) {
      stopLoops();
      pump(true);
    } else {
      startLoops();
    }
    publishState();
  }

  void singleStep() {
    if (!settings.paused) pause(true);
    scene->loops().stepOnce();
    pump(true);
  }

  void openScene(const std::string& name) {
    const auto found =
        std::find_if(options.scenes.begin(), options.scenes.end(), [&](const SceneEntry& s) { return s.name == name; });
    if (found == options.scenes.end()) throw InputError("scene", name, "is none of those to choose from");
    load(options.open(*found), "opening " + name);
  }

  // --- a dropped surface

  void beginPlacing(const std::filesystem::path& file, const std::string& name) {
    Placing next{file, name, {}, placing ? placing->before : base};
    const SceneConfig config = previewOfSurface(file, name, next.preview);
    loadSurface(config, file, "reading " + name, std::move(next));
  }

  void loadSurface(const SceneConfig& config, const std::filesystem::path& file, const std::string& busy,
                   std::optional<Placing> next = std::nullopt) {
    try {
      load(config, busy, std::move(next));
    } catch (const std::exception& e) {
      throw RunError(withoutFolder(e.what(), file));
    }
  }

  void placeSurface(const std::filesystem::path& file, const std::string& name, const PlaceMessage& m) {
    loadSurface(sceneOfSurface(file, name, m), file, "making " + name + " soft");
    notice(false, describePlaced(scene->scene()));
    for (const std::string& note : scene->scene().notes) notice(false, note);
    const double weight = scene->scene().world.tool().model.totalMass() * scene->scene().world.gravity.norm();
    const double peak = scene->config().device.limits.peak_force;
    if (weight > peak)
      notice(true,
             fmt::format("it weighs {:.3g} N, and the device gives {:.3g} N: choose a smaller size", weight, peak));
  }

  void requirePlacing() const {
    if (!placing) throw InputError("message", "type", "no surface waits to be placed");
  }

  void place(const PlaceMessage& m) {
    requirePlacing();
    const Placing now = *placing;
    settings.paused = false;
    try {
      placeSurface(now.file, now.name, m);
    } catch (const std::exception& e) {
      const std::string cause = e.what();
      if (cause.find("holds no node") == std::string::npos) throw;
      throw RunError(cause + "; a larger box or brush, or more tetrahedra, would reach one");
    }
  }

  void cancelPlacing() {
    requirePlacing();
    const SceneConfig before = placing->before;
    load(before, "back to " + before.name);
  }

  // --- files

  void save(int viewer) {
    const SceneConfig& config = scene->config();
    const bool dropped = config.file.parent_path().parent_path() == options.surface_folder;
    std::string text = "# Saved by palpate view.\n";
    if (dropped) text += "# Its place is the folder of the surface that it names.\n";
    text += sceneText(config, {settings.friction, settings.stiffness},
                      dropped ? SavedFiles::as_named : SavedFiles::absolute);
    audience.textTo(viewer, share(savedMessage(config.name + ".yaml", text)));
  }

  void record(bool on) {
    if (on == (files != nullptr)) return;
    stopLoops();
    scene->pump(audience, generation, false);
    try {
      if (on) {
        beginRecording();
      } else {
        endRecording("viewer");
      }
    } catch (...) {
      startLoops();
      throw;
    }
    publishState();
    startLoops();
  }

  // Both while the loops stand still.
  void beginRecording() {
    const std::time_t now = std::time(nullptr);
    const auto folder =
        options.record_folder / fmt::format("{}-{:%Y%m%d-%H%M%S}", scene->config().name, fmt::localtime(now));
    SceneConfig config = scene->config();
    config.duration = kRecordedPlot;
    auto tables = std::make_unique<RunFiles>(folder, config);
    recorder = std::make_unique<Recorder>(tables->stage("recording.palpate"), config, scene->scene(), settings);
    files = std::move(tables);
    scene->record(recorder.get(), files->sink());
    status.recording = folder.string();
  }

  std::string recordingFailure() const { return files->failure().empty() ? recorder->failure() : files->failure(); }

  // Does not throw: whatever becomes of the files, the run goes on.
  void endRecording(const std::string& by) {
    if (!files) return;
    scene->record(nullptr, {});
    const std::string folder = std::exchange(status.recording, {});
    try {
      recorder->finish();
      RunOutcome outcome = scene->loops().outcome();
      outcome.ended_by = by;
      outcome.failure = recordingFailure();
      files->finish(scene->scene(), outcome, nullptr);
      if (const std::string cause = recordingFailure(); cause.empty()) {
        notice(false, "recorded in " + folder);
      } else {
        recordingFailed(fmt::format("the recording ended: {}; what was recorded until then is in {}", cause, folder));
      }
    } catch (const std::exception& e) {
      recordingFailed(fmt::format("the recording in {} is lost: {}", folder, e.what()));
    }
    recorder.reset();
    files.reset();
  }

  void recordingFailed(const std::string& text) {
    notice(true, text);
    if (failure.empty()) failure = text;
  }

  SceneConfig base;  // as it would be begun anew
  InteractiveOptions options;
  Audience& audience;
  InteractiveSettings settings;
  InteractiveStatus status;
  HandCommand command;
  std::unique_ptr<RunningScene> scene;
  const char* told_failure = nullptr;  // of the device
  std::unique_ptr<RunFiles> files;
  std::unique_ptr<Recorder> recorder;
  std::uint32_t generation = 0;
  std::optional<Placing> placing;
  double path_start = 0;  // when the motion was begun, in the run's time [s]
  Clock::time_point hand_moved{};
  Clock::time_point stats_time = Clock::now();
  double stats_cpu = 0;
  std::atomic<int> surfaces{0};
  std::string failure;  // of a recording

  // --- shared with the callers' threads
  std::mutex mutex;
  std::condition_variable wake;
  std::deque<Task> tasks;
  std::atomic<bool> stopping{false};
  std::thread thread;

  /// @return false where too much of it waits already
  bool post(Task task, bool may_be_lost = false) {
    {
      const std::lock_guard lock(mutex);
      if (stopping || (may_be_lost && tasks.size() >= kMostTasks)) return true;
      if (!task.load.empty() && !makeRoom(task.load)) return false;
      tasks.push_back(std::move(task));
    }
    wake.notify_one();
    return true;
  }

  // Of scenes to be built that wait, an equal one that only another could come after is needless. Too many are refused.
  bool makeRoom(const std::string& load) {
    int waiting = 0;
    bool newest = true;
    for (auto task = tasks.end(); task != tasks.begin();) {
      --task;
      if (task->records) newest = false;
      if (task->load.empty()) continue;
      if (newest && task->replaceable && task->load == load) {
        tasks.erase(task);
        return true;
      }
      newest = false;
      ++waiting;
    }
    return waiting < kMostLoads;
  }
};

InteractiveRun::InteractiveRun(SceneConfig config, InteractiveOptions options, Audience& audience)
    : impl_(std::make_unique<Impl>(std::move(config), std::move(options), audience)) {}

InteractiveRun::~InteractiveRun() { stop(); }

void InteractiveRun::start() {
  impl_->load(impl_->base, "");
  if (impl_->options.record_from_start) impl_->record(true);
  impl_->thread = std::thread([this, executor = Executor::current()] {
    const ExecutorScope scope(executor);
    impl_->run();
  });
}

void InteractiveRun::askToStop() {
  {
    const std::lock_guard lock(impl_->mutex);
    impl_->stopping = true;
  }
  impl_->wake.notify_one();
}

void InteractiveRun::stop() {
  askToStop();
  if (impl_->thread.joinable()) impl_->thread.join();
}

const std::string& InteractiveRun::failure() const { return impl_->failure; }

void InteractiveRun::joined(int) {
  impl_->post({[i = impl_.get()] {
    ++i->status.viewers;
    i->publishState();
    i->pump(true);
  }});
}

void InteractiveRun::left(int viewer) {
  impl_->post({[i = impl_.get(), viewer] {
    --i->status.viewers;
    i->releaseHand(viewer);
    i->publishState();
  }});
}

void InteractiveRun::message(int viewer, std::string_view json) {
  try {
    ViewerCommand command = parseCommand(json);
    Task task = taskOf(command);
    task.work = [i = impl_.get(), viewer, command = std::move(command)] {
      try {
        i->carryOut(viewer, command);
      } catch (const InputError& e) {
        i->audience.textTo(viewer, share(noticeMessage(true, e.what())));
      }
    };
    if (!impl_->post(std::move(task), true)) throw InputError("message", "", "too many scenes wait to be built");
  } catch (const InputError& e) {
    impl_->audience.textTo(viewer, share(noticeMessage(true, e.what())));
  }
}

std::optional<std::string> InteractiveRun::surface(const std::string& name, std::string&& content, bool place) {
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
  const auto work = [i = impl_.get(), file, name, place] {
    if (place) {
      i->beginPlacing(file, name);
    } else {
      i->placeSurface(file, name, {});
    }
  };
  if (!impl_->post({work, "surface " + name, true})) return "too many scenes wait to be built";
  return std::nullopt;
}

}  // namespace palpate
