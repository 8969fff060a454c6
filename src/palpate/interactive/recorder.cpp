#include "palpate/interactive/recorder.h"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <system_error>

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
  whole_ = protocol::kRecordingMagic.size();
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
  if (!failure_.empty()) return;
  const auto bytes = static_cast<std::uint32_t>(payload.size());
  out_.write(reinterpret_cast<const char*>(&kind), sizeof kind);
  out_.write(reinterpret_cast<const char*>(&bytes), sizeof bytes);
  out_.write(payload.data(), static_cast<std::streamsize>(payload.size()));
  const char zeros[protocol::kRecordAlignment] = {};
  const std::size_t beyond = payload.size() % sizeof zeros;
  const std::size_t padding = beyond > 0 ? sizeof zeros - beyond : 0;
  out_.write(zeros, static_cast<std::streamsize>(padding));
  out_.flush();
  if (!out_) return giveUp(errno);
  whole_ += sizeof kind + sizeof bytes + payload.size() + padding;
}

void Recorder::giveUp(int cause) {
  failure_ = path_.string() + ": cannot be written: " + std::strerror(cause);
  failed_.store(true, std::memory_order_relaxed);
  out_.close();
  std::error_code ignored;
  std::filesystem::resize_file(path_, whole_, ignored);
}

std::string Recorder::failure() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

void Recorder::finish() {
  const std::lock_guard lock(mutex_);
  if (!samples_.empty()) flushSamples();
  if (!failure_.empty()) return;
  out_.close();
  if (!out_) giveUp(errno);
}

}  // namespace palpate
