#include "palpate/interactive/recorder.h"

#include <cmath>

#include "palpate/common/error.h"

namespace palpate {
namespace {

using protocol::RecordKind;
constexpr std::uint32_t kGeneration = 1;
constexpr int kBatch = 500;  // ticks

}  // namespace

Recorder::Recorder(const std::filesystem::path& file, const SceneConfig& config, const BuiltScene& scene,
                   const InteractiveSettings& settings)
    : path_(file),
      out_(file, std::ios::binary | std::ios::trunc),
      reader_(scene.world),
      samples_(scene.world.link, scene.haptic.proxy.mass * scene.haptic.proxy.gravity, kGeneration),
      substeps_(config.substeps) {
  if (!out_) throw InputError(file.string(), "", "cannot be written");
  out_ << protocol::kRecordingMagic;
  last_tick_.device.pose = scene.start;
  last_tick_.proxy = scene.world.tool().state.handle.pose;
  put(RecordKind::text, sceneMessage(config, scene, {}, kGeneration));
  put(RecordKind::binary, geometryMessage(scene.world, kGeneration));
  put(RecordKind::text, stateMessage(config, settings, {}, kGeneration));
  put(RecordKind::extra, reader_.materials(scene.world));
}

RunSink Recorder::watch(RunSink sink) {
  RunSink out = sink;
  out.tick = [this, next = sink.tick](const TickRecord& r) {
    tick(r);
    next(r);
  };
  out.visual = [this, next = sink.visual](const VisualRecord& r) {
    step(r, substeps_);
    next(r);
  };
  out.stepped = [this, next = sink.stepped](const World& world, const VisualRecord& r) {
    state(world, r);
    next(world, r);
  };
  return out;
}

void Recorder::tick(const TickRecord& tick) {
  const std::lock_guard lock(mutex_);
  last_tick_ = tick;
  samples_.add(tick);
  if (samples_.ticks() >= kBatch) flushSamples();
}

void Recorder::step(const VisualRecord& step, int substeps) {
  const std::lock_guard lock(mutex_);
  samples_.add(step, substeps);
}

// The frame of a step has the poses of the newest tick, which is the one before the step's end.
void Recorder::state(const World& world, const VisualRecord& step) {
  const std::lock_guard lock(mutex_);
  ++state_.step;
  reader_.read(world, true, state_);
  TickRecord tick = last_tick_;
  tick.time = step.time;
  put(RecordKind::binary, frameMessage(state_, tick, 0, kGeneration, true));
  put(RecordKind::extra, stepExtra(world));
}

void Recorder::flushSamples() { put(RecordKind::binary, samples_.take()); }

void Recorder::put(RecordKind kind, const std::string& payload) {
  const auto bytes = static_cast<std::uint32_t>(payload.size());
  out_.write(reinterpret_cast<const char*>(&kind), sizeof kind);
  out_.write(reinterpret_cast<const char*>(&bytes), sizeof bytes);
  out_.write(payload.data(), static_cast<std::streamsize>(payload.size()));
  const char zeros[protocol::kRecordAlignment] = {};
  const std::size_t beyond = payload.size() % sizeof zeros;
  if (beyond > 0) out_.write(zeros, static_cast<std::streamsize>(sizeof zeros - beyond));
}

void Recorder::finish() {
  const std::lock_guard lock(mutex_);
  if (!samples_.empty()) flushSamples();
  out_.close();
  if (!out_) throw RunError(path_.string() + ": could not be written whole");
}

}  // namespace palpate
