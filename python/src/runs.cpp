// Whole runs in virtual time, one or many at once, and the one-dimensional experiment.

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>

#include "owners.h"
#include "palpate/common/error.h"
#include "palpate/one_d/experiment.h"
#include "palpate/session/lockstep.h"

namespace palpate::python {
namespace {

// --- what a run leaves

constexpr std::array<const char*, 28> kTickColumns{
    "time_s",    "device_x_m", "device_y_m", "device_z_m", "device_qw",  "device_qx",  "device_qy",
    "device_qz", "proxy_x_m",  "proxy_y_m",  "proxy_z_m",  "proxy_qw",   "proxy_qx",   "proxy_qy",
    "proxy_qz",  "raw_fx_N",   "raw_fy_N",   "raw_fz_N",   "raw_tx_Nm",  "raw_ty_Nm",  "raw_tz_Nm",
    "sent_fx_N", "sent_fy_N",  "sent_fz_N",  "sent_tx_Nm", "sent_ty_Nm", "sent_tz_Nm", "model_age_s"};

/// Rows of a stretch of a run, in C order.
struct Trace {
  std::vector<double> ticks;  ///< kTickColumns
  std::vector<double> device_twists;
  std::vector<std::uint32_t> flags;
  std::vector<HandleModel> models;   ///< one a visual step
  std::vector<StepReport> reports;   ///< likewise
  std::vector<double> visual_times;  ///< likewise

  void add(const Pose& pose) {
    ticks.insert(ticks.end(), pose.position.begin(), pose.position.end());
    const Quat& q = pose.rotation;
    ticks.insert(ticks.end(), {q.w(), q.x(), q.y(), q.z()});
  }
  void add(const TickRecord& r) {
    ticks.push_back(r.time);
    add(r.device.pose);
    add(r.proxy);
    ticks.insert(ticks.end(), r.raw.begin(), r.raw.end());
    ticks.insert(ticks.end(), r.sent.begin(), r.sent.end());
    ticks.push_back(r.model_age);
    device_twists.insert(device_twists.end(), r.device.twist.begin(), r.device.twist.end());
    flags.push_back(r.flags.bits());
  }
  void add(const VisualRecord& r) {
    models.push_back(r.model);
    reports.push_back(r.step);
    visual_times.push_back(r.time);
  }
};

// --- devices

/// A device whose states are given, one a tick; it holds the last one. Feels nothing.
class MotionDevice final : public Device {
 public:
  /// @param first  tick of the first state
  MotionDevice(std::vector<DeviceState> states, std::int64_t first, double dt, const DeviceLimits& limits)
      : states_(std::move(states)), first_(first), dt_(dt), limits_(limits) {}
  const char* name() const noexcept override { return "motion"; }
  DeviceLimits limits() const noexcept override { return limits_; }
  DeviceState sample(double t) noexcept override {
    const auto tick = static_cast<std::size_t>(std::max<std::int64_t>(0, std::llround(t / dt_) - first_));
    return states_[std::min(tick, states_.size() - 1)];
  }
  void apply(const Vec6&, double, double) noexcept override {}

 private:
  std::vector<DeviceState> states_;
  std::int64_t first_;
  double dt_;
  DeviceLimits limits_;
};

/// A device written in Python: for teaching, as each tick then waits for the interpreter.
class SlowPythonDevice final : public Device {
 public:
  SlowPythonDevice(py::object device, const Pose& start, const DeviceLimits& limits)
      : device_(std::move(device)), limits_(limits) {
    last_.pose = start;
  }
  SlowPythonDevice(const SlowPythonDevice&) = delete;
  SlowPythonDevice& operator=(const SlowPythonDevice&) = delete;
  ~SlowPythonDevice() override {
    const py::gil_scoped_acquire gil;
    device_ = py::object();
  }
  const char* name() const noexcept override { return "slow_device"; }
  DeviceLimits limits() const noexcept override { return limits_; }
  DeviceState sample(double t) noexcept override {
    guarded([&] { last_ = stateFrom(device_.attr("sample")(t), "sample()"); });
    return last_;
  }
  void apply(const Vec6& wrench, double t, double dt) noexcept override {
    guarded([&] { device_.attr("apply")(copied(wrench), t, dt); });
  }
  /// What it has thrown; the run is to end.
  std::exception_ptr takeFailure() noexcept { return std::exchange(failure_, nullptr); }
  bool failed() const noexcept { return failure_ != nullptr; }

 private:
  template <class Call>
  void guarded(Call&& call) noexcept {
    if (failure_) return;
    const py::gil_scoped_acquire gil;
    try {
      call();
    } catch (...) {
      failure_ = std::current_exception();
    }
  }

  py::object device_;
  DeviceState last_;
  DeviceLimits limits_;
  std::exception_ptr failure_;
};

// Rows of 7 (pose) or 13 (pose and twist) numbers. Quaternions are taken as from a recording. @throws ValueError
std::vector<DeviceState> statesFrom(const double* rows, py::ssize_t count, py::ssize_t columns) {
  std::vector<DeviceState> out(static_cast<std::size_t>(count));
  for (DeviceState& state : out) {
    state.pose.position = Eigen::Map<const Vec3>(rows);
    Quat& rotation = state.pose.rotation;
    rotation = Quat(rows[3], rows[4], rows[5], rows[6]);
    const double norm = rotation.norm();
    if (!(norm > 0.9 && norm < 1.1)) {
      throw py::value_error("motion: row " + std::to_string(&state - out.data()) +
                            ": quaternion qw qx qy qz must have norm 1");
    }
    // one that is a unit quaternion already keeps its bits
    if (std::abs(norm - 1.0) > 1e-12) rotation.normalize();
    if (columns == 13) state.twist = Eigen::Map<const Vec6>(rows + 7);
    rows += columns;
  }
  return out;
}

void checkMotion(const DoubleArray& motion, py::ssize_t dimensions) {
  const py::ssize_t columns = motion.ndim() > 0 ? motion.shape(motion.ndim() - 1) : 0;
  if (motion.ndim() != dimensions || motion.size() == 0 || (columns != 7 && columns != 13)) {
    throw py::value_error(
        "motion: rows are ticks, of x y z, qw qx qy qz and, where known, vx vy vz, wx wy wz: 7 or 13 columns");
  }
  for (py::ssize_t i = 0; i < motion.size(); ++i) {
    if (!std::isfinite(motion.data()[i])) throw py::value_error("motion: is not finite");
  }
}

// --- a run

class Run {
 public:
  Run(const SceneConfig& config, std::vector<DeviceState> motion)
      : Run(std::make_shared<WorldOwner>(config), std::move(motion)) {}

  Run(std::shared_ptr<WorldOwner> owner, std::vector<DeviceState> motion) : owner_(std::move(owner)) {
    if (!motion.empty()) {
      owner_->timing.duration = static_cast<double>(motion.size()) * owner_->timing.haptic_step;
      follow(std::move(motion));
    }
    begin();
  }

  Run(const SceneConfig& config, py::object slow_device) : owner_(std::make_shared<WorldOwner>(config)) {
    auto device =
        std::make_unique<SlowPythonDevice>(std::move(slow_device), owner_->built.start, owner_->built.device->limits());
    slow_ = device.get();
    setDevice(std::move(device));
    begin();
  }

  /// From the next tick on the device has these states, one a tick, and then stays in the last one.
  void follow(std::vector<DeviceState> motion) {
    if (slow_) throw py::value_error("motion: there is a slow_device already");
    setDevice(std::make_unique<MotionDevice>(std::move(motion), tick_, owner_->timing.haptic_step,
                                             owner_->built.device->limits()));
  }
  /// Up to a tick, without it, or until told to stop. The caller holds no GIL.
  void runUntil(std::int64_t end, Trace& trace) {
    trace_ = &trace;
    lockstep_->runUntil(end);
    trace_ = nullptr;
  }

  /// Next one; any thread.
  std::int64_t tick() const { return tick_; }
  void restore(const LockstepState& state) {
    lockstep_->restore(state);
    tick_ = state.tick;
    owner_->wasSet();
  }
  LockstepRun& lockstep() { return *lockstep_; }
  const std::shared_ptr<WorldOwner>& owner() const { return owner_; }
  SlowPythonDevice* slowDevice() const { return slow_; }
  RunSink& sink() { return sink_; }

 private:
  void setDevice(std::unique_ptr<Device> device) { owner_->built.device = std::move(device); }
  void begin() {
    sink_.tick = [this](const TickRecord& r) {
      trace_->add(r);
      ++tick_;
    };
    sink_.visual = [this](const VisualRecord& r) {
      trace_->add(r);
      owner_->endStep(r.step);
    };
    owner_->beginStep();
    lockstep_.emplace(owner_->built, owner_->timing, sink_);
  }

  std::shared_ptr<WorldOwner> owner_;
  SlowPythonDevice* slow_ = nullptr;
  RunSink sink_;
  Trace* trace_ = nullptr;
  std::atomic<std::int64_t> tick_{0};
  std::optional<LockstepRun> lockstep_;
};

// Rows of one run. @throws ValueError
std::vector<DeviceState> motionFrom(py::handle motion) {
  const DoubleArray array = doubles(motion, "motion");
  checkMotion(array, 2);
  return statesFrom(array.data(), array.shape(0), array.shape(1));
}

std::shared_ptr<Trace> advance(Run& run, py::handle ticks, py::handle motion) {
  auto trace = std::make_shared<Trace>();
  const WorldOwner::Use use(*run.owner());
  const std::int64_t now = run.tick();
  std::int64_t count = std::max<std::int64_t>(0, run.lockstep().ticks() - now);
  if (!motion.is_none()) {
    std::vector<DeviceState> states = motionFrom(motion);
    count = static_cast<std::int64_t>(states.size());
    run.follow(std::move(states));
  }
  if (!ticks.is_none()) {
    const auto wanted = ticks.cast<std::int64_t>();
    if (wanted < 0) throw py::value_error("ticks: must not be negative");
    count = std::min(wanted, count);
  }
  const std::int64_t end = now + count;
  run.owner()->beginStep();
  Interrupts interrupts;
  run.sink().stopped = [&] { return (run.slowDevice() && run.slowDevice()->failed()) || interrupts.asked(); };
  {
    const py::gil_scoped_release release;
    run.runUntil(end, *trace);
  }
  run.sink().stopped = [] { return false; };
  if (run.slowDevice()) {
    if (const std::exception_ptr failure = run.slowDevice()->takeFailure()) std::rethrow_exception(failure);
  }
  if (interrupts.happened()) throw py::error_already_set();
  return trace;
}

std::unique_ptr<Run> makeRun(const SceneConfig& scene, py::object motion, py::object slow_device) {
  if (!slow_device.is_none()) {
    if (!motion.is_none()) throw py::value_error("slow_device: there is a motion already");
    const SceneConfig config = scene;
    return std::make_unique<Run>(config, std::move(slow_device));
  }
  std::vector<DeviceState> states;
  if (!motion.is_none()) states = motionFrom(motion);
  const py::gil_scoped_release release;
  return std::make_unique<Run>(scene, std::move(states));
}

// --- many runs

struct Job {
  std::shared_ptr<SceneConfig> scene;
  std::vector<DeviceState> motion;
  const LockstepState* start = nullptr;
  std::shared_ptr<Trace> trace = std::make_shared<Trace>();
};

/// Scenes built by one thread: the same one is built once.
class Builder {
 public:
  std::shared_ptr<WorldOwner> build(const std::shared_ptr<SceneConfig>& scene) {
    if (scene != scene_) {
      owner_ = std::make_shared<WorldOwner>(*scene);
      scene_ = scene;
      start_ = owner_->world().state();
      memory_ = owner_->built.device->save();
      timing_ = owner_->timing;
      own_device_ = nullptr;
    } else {
      if (own_device_) owner_->built.device = std::move(own_device_);
      owner_->world().restore(start_);
      owner_->built.device->restore(memory_);
      owner_->timing = timing_;
    }
    return owner_;
  }
  /// The scene's device waits while another one takes its place.
  void keepDevice() { own_device_ = std::move(owner_->built.device); }

 private:
  std::shared_ptr<SceneConfig> scene_;
  std::shared_ptr<WorldOwner> owner_;
  WorldState start_;
  DeviceMemory memory_;
  RunTiming timing_;
  std::unique_ptr<Device> own_device_;
};

void runJob(Job& job, Builder& builder, const std::atomic<bool>& stopped) {
  const std::shared_ptr<WorldOwner> owner = builder.build(job.scene);
  const std::int64_t first = job.start ? job.start->tick : 0;
  const auto rows = static_cast<std::int64_t>(job.motion.size());
  if (rows > 0) {
    const DeviceLimits limits = owner->built.device->limits();
    builder.keepDevice();
    owner->built.device =
        std::make_unique<MotionDevice>(std::move(job.motion), first, owner->timing.haptic_step, limits);
  }
  Run run(owner, {});
  run.sink().stopped = [&stopped] { return stopped.load(std::memory_order_relaxed); };
  if (job.start) {
    LockstepState state = *job.start;
    if (rows > 0) state.device = owner->built.device->save();  // not of this one
    run.restore(state);
  }
  run.runUntil(rows > 0 ? first + rows : run.lockstep().ticks(), *job.trace);
}

/// Threads at work on a list of jobs, while the caller looks out for Ctrl-C. The caller holds no GIL.
class Batch {
 public:
  Batch(std::vector<Job>& jobs, int threads) : jobs_(jobs) {
    for (int i = 0; i < threads; ++i) workers_.emplace_back([this] { work(); });
  }
  /// @returns true if it was interrupted; the exception is then set. Rethrows what the first failed job threw.
  bool wait() {
    bool interrupted = false;
    {
      std::unique_lock lock(mutex_);
      while (!ended_.wait_for(lock, std::chrono::milliseconds(50), [this] { return done_ == workers_.size(); })) {
        lock.unlock();
        {
          const py::gil_scoped_acquire gil;
          interrupted = interrupted || PyErr_CheckSignals() != 0;
        }
        if (interrupted) stopped_ = true;
        lock.lock();
      }
    }
    for (std::thread& worker : workers_) worker.join();
    workers_.clear();
    if (failure_ && !interrupted) std::rethrow_exception(failure_);
    return interrupted;
  }

 private:
  void work() {
    Builder builder;
    for (std::size_t i = next_++; i < jobs_.size() && !stopped_; i = next_++) {
      try {
        runJob(jobs_[i], builder, stopped_);
      } catch (...) {
        const std::lock_guard lock(mutex_);
        if (i < failed_) {
          failed_ = i;
          failure_ = std::current_exception();
        }
        stopped_ = true;
      }
    }
    const std::lock_guard lock(mutex_);
    ++done_;
    ended_.notify_one();
  }

  std::vector<Job>& jobs_;
  std::atomic<std::size_t> next_{0};
  std::atomic<bool> stopped_{false};
  std::mutex mutex_;
  std::condition_variable ended_;
  std::size_t done_ = 0;
  std::size_t failed_ = std::numeric_limits<std::size_t>::max();
  std::exception_ptr failure_;
  std::vector<std::thread> workers_;
};

// One thing for all jobs, or a list with one for each.
template <class T>
std::vector<T> listFrom(py::handle source, const char* what) {
  if (py::isinstance<py::sequence>(source)) {
    std::vector<T> out;
    for (const py::handle item : source.cast<py::sequence>()) out.push_back(item.cast<T>());
    if (out.empty()) throw py::value_error(std::string(what) + ": is an empty list");
    return out;
  }
  return {source.cast<T>()};
}

std::size_t joinSizes(std::size_t a, std::size_t b, const char* what) {
  if (a == b || b == 1) return a;
  if (a == 1) return b;
  throw py::value_error(std::string(what) + ": " + std::to_string(b) + " of them do not go with " + std::to_string(a));
}

py::list rollout(py::handle scene, py::handle motion, py::handle state, py::handle threads) {
  const auto scenes = listFrom<std::shared_ptr<SceneConfig>>(scene, "scene");
  std::size_t count = scenes.size();
  std::optional<DoubleArray> array;
  std::size_t motions = 1;
  if (!motion.is_none()) {
    array = doubles(motion, "motion");
    checkMotion(*array, array->ndim() == 2 ? 2 : 3);
    if (array->ndim() == 3) motions = static_cast<std::size_t>(array->shape(0));
    count = joinSizes(count, motions, "motion");
  }
  std::vector<const LockstepState*> states;
  if (!state.is_none()) {
    states = listFrom<const LockstepState*>(state, "state");
    count = joinSizes(count, states.size(), "state");
  }
  std::vector<Job> jobs(count);
  for (std::size_t i = 0; i < count; ++i) {
    jobs[i].scene = scenes[scenes.size() == 1 ? 0 : i];
    if (!states.empty()) jobs[i].start = states[states.size() == 1 ? 0 : i];
    if (!array) continue;
    const py::ssize_t rows = array->shape(array->ndim() - 2), columns = array->shape(array->ndim() - 1);
    const auto offset = motions == 1 ? 0 : static_cast<py::ssize_t>(i) * rows * columns;
    jobs[i].motion = statesFrom(array->data() + offset, rows, columns);
  }
  const int wanted = threads.is_none() ? static_cast<int>(std::thread::hardware_concurrency()) : threads.cast<int>();
  if (!threads.is_none() && wanted < 1) throw py::value_error("threads: must be at least 1");
  {
    const py::gil_scoped_release release;
    Batch batch(jobs, std::clamp(wanted, 1, static_cast<int>(std::min<std::size_t>(count, 256))));
    if (batch.wait()) {
      const py::gil_scoped_acquire gil;
      throw py::error_already_set();
    }
  }
  py::list out;
  for (const Job& job : jobs) out.append(job.trace);
  return out;
}

template <class Get>
auto ofTrace(Get get) {
  return [get](const py::object& self) { return get(self.cast<const Trace&>(), self); };
}

py::array columnsOf(const Trace& trace, py::ssize_t first, py::ssize_t count, py::handle self) {
  constexpr py::ssize_t kSize = sizeof(double), kRow = kTickColumns.size();
  const py::ssize_t rows = static_cast<py::ssize_t>(trace.flags.size());
  const double* data = trace.ticks.empty() ? nullptr : trace.ticks.data() + first;
  if (count == 1) return view(data, {rows}, {kRow * kSize}, self, Access::read);
  return view(data, {rows, count}, {kRow * kSize, kSize}, self, Access::read);
}
auto columns(py::ssize_t first, py::ssize_t count) {
  return ofTrace([=](const Trace& trace, py::handle self) { return columnsOf(trace, first, count, self); });
}

void bindTrace(py::module_& module) {
  py::class_<Trace, std::shared_ptr<Trace>> trace(
      module, "Trace", "Rows of a stretch of a run: one a tick, and one a visual step. Arrays are read-only views.");
  py::tuple names(kTickColumns.size());
  for (std::size_t i = 0; i < kTickColumns.size(); ++i) names[i] = kTickColumns[i];
  trace.attr("COLUMNS") = names;
  trace.def("__len__", [](const Trace& self) { return self.flags.size(); })
      .def_property_readonly("ticks", ofTrace([](const Trace& t, py::handle self) {
                               return matrixView(t.ticks, static_cast<py::ssize_t>(kTickColumns.size()), self);
                             }),
                             "(ticks, 28) in the columns COLUMNS: those of haptic.csv but for the flags.")
      .def_property_readonly("time", columns(0, 1), "(ticks,) [s].")
      .def_property_readonly("device", columns(1, 7), "Pose (ticks, 7): x y z [m], qw qx qy qz.")
      .def_property_readonly("proxy", columns(8, 7), "Pose of the proxy (ticks, 7).")
      .def_property_readonly("raw", columns(15, 6), "Wrench on the device before safety (ticks, 6) [N, N m].")
      .def_property_readonly("sent", columns(21, 6), "Wrench that goes to the device (ticks, 6) [N, N m].")
      .def_property_readonly("model_age", columns(27, 1), "(ticks,) [s].")
      .def_property_readonly(
          "device_twist", ofTrace([](const Trace& t, py::handle self) { return matrixView(t.device_twists, 6, self); }),
          "(ticks, 6) [m/s, rad/s].")
      .def_property_readonly("flags",
                             ofTrace([](const Trace& t, py::handle self) { return vectorView(t.flags, self); }),
                             "(ticks,) uint32, bits as in haptic.csv.")
      .def_property_readonly("visual_time",
                             ofTrace([](const Trace& t, py::handle self) { return vectorView(t.visual_times, self); }),
                             "At which each visual step began (steps,) [s].")
      .def_property_readonly("coupling", ofTrace([](const Trace& t, py::handle self) {
                               return view(t.models.empty() ? nullptr : t.models.front().force.data(),
                                           {static_cast<py::ssize_t>(t.models.size()), 6},
                                           {sizeof(HandleModel), sizeof(double)}, self, Access::read);
                             }),
                             "Wrench of the tool on the handle (steps, 6) [N, N m].")
      .def_property_readonly(
          "models",
          [](const Trace& self) {
            py::list out;
            for (const HandleModel& model : self.models) out.append(model);
            return out;
          },
          "Handle model of each visual step: copies.")
      .def_property_readonly(
          "reports",
          [](const Trace& self) {
            py::list out;
            for (const StepReport& report : self.reports) out.append(report);
            return out;
          },
          "StepReport of each visual step: copies.");
}

void bindRun(py::module_& module) {
  py::class_<LockstepState, std::shared_ptr<LockstepState>>(module, "RunState", "What Run.save() took.")
      .def_readonly("tick", &LockstepState::tick, "The next one.");
  py::class_<Run>(module, "Run", "A scene that runs in virtual time, as palpate run does: the same to the bit.")
      .def(py::init(&makeRun), py::arg("scene"), py::kw_only(), py::arg("motion") = py::none(),
           py::arg("slow_device") = py::none(),
           "motion: the device's pose (and twist) at each tick (ticks, 7 or 13), in place of the scene's device; the "
           "last row holds. slow_device: an object with sample(t) -> Pose or DeviceState and apply(wrench, t, dt); "
           "each tick then waits for Python, which is for teaching only. Releases the GIL while it builds.")
      .def(
          "advance", &advance, py::arg("ticks") = py::none(), py::kw_only(), py::arg("motion") = py::none(),
          "Runs so many ticks, at most to the end, and returns their rows. motion: of the device from now on, as for "
          "the constructor; by default for as many ticks as it has, past the end of the scene as well. So a controller "
          "may look at each visual step and say what the device does next. Releases the GIL; Ctrl-C ends it.")
      .def(
          "finish", [](Run& self) { return advance(self, py::none(), py::none()); }, "Runs to the end of the scene.")
      .def_property_readonly("tick", &Run::tick, "The next one.")
      .def_property_readonly(
          "ticks", [](Run& self) { return self.lockstep().ticks(); }, "Of the whole run.")
      .def_property_readonly(
          "world", [](const Run& self) { return self.owner(); }, "Look, and leave it as it is.")
      .def(
          "save",
          [](Run& self) {
            if (self.slowDevice()) throw std::runtime_error("slow_device: what it remembers cannot be saved");
            const WorldOwner::Use use(*self.owner());
            return std::make_shared<LockstepState>(self.lockstep().state());
          },
          "All of the run: restored, it goes on to the bit.")
      .def(
          "restore",
          [](Run& self, const LockstepState& state) {
            const WorldOwner::Use use(*self.owner());
            self.restore(state);
          },
          py::arg("state"), "Of a run of the same scene.");
  module.def("rollout", &rollout, py::arg("scene"), py::kw_only(), py::arg("motion") = py::none(),
             py::arg("state") = py::none(), py::arg("threads") = py::none(),
             "Runs many scenes at once, one thread a run, and returns their traces in order. scene: one, or a list. "
             "motion: the device's motion as in Run, (ticks, 7 or 13) or (runs, ticks, 7 or 13). state: a RunState to "
             "go on from, or a list; row i of a motion is then for its tick + i. threads: default one a core. "
             "Releases the GIL; a failed run ends all, and is raised.");
}

// --- one dimension

py::array copyOf(const std::vector<double>& v) {
  return copied(Eigen::Map<const VecX>(v.data(), static_cast<Eigen::Index>(v.size())));
}

py::dict dictOf(const one_d::Run& run) {
  py::dict out;
  out["method"] = run.method;
  out["visual_dt"] = run.visual_dt;
  out["latency"] = run.latency;
  out["device"] = copyOf(run.trace.device);
  out["handle"] = copyOf(run.trace.handle);
  out["tool"] = copyOf(run.trace.tool);
  out["force"] = copyOf(run.trace.force);
  out["drag"] = run.drag ? py::object(py::float_(*run.drag)) : py::object(py::none());
  out["rms"] = run.rms;
  out["peak_error"] = run.peak_error;
  return out;
}

py::dict oneD(const std::string& config) {
  one_d::Results results;
  {
    const py::gil_scoped_release release;
    results = one_d::runExperiment(config.empty() ? one_d::Config{} : one_d::parseConfig(config, "config"));
  }
  py::dict out;
  out["time"] = copyOf(results.time);
  out["reference"] = dictOf(results.reference);
  py::list runs;
  for (const one_d::Run& run : results.runs) runs.append(dictOf(run));
  out["runs"] = runs;
  return out;
}

}  // namespace

void bindRuns(py::module_& module) {
  bindTrace(module);
  bindRun(module);
  module.def("one_d", &oneD, py::arg("config") = "",
             "The one-dimensional experiment (YAML keys as palpate one-d): time, reference, runs; each run a dict of "
             "method, visual_dt, latency, device, handle, tool [m], force [N], drag, rms, peak_error [N].");
}

}  // namespace palpate::python
