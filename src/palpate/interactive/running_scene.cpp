#include "palpate/interactive/running_scene.h"

#include <utility>

#include "palpate/scene/method.h"

namespace palpate {
namespace {

Bytes share(std::string text) { return std::make_shared<const std::string>(std::move(text)); }

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

}  // namespace

RunningScene::RunningScene(const SceneConfig& config, const InteractiveSettings& settings, std::uint32_t generation)
    : config_(config),
      scene_(buildScene(stiffened(config, settings.stiffness))),
      mouse_(replaceDevice()),
      reader_(scene_.world),
      encoder_(scene_.world.link, scene_.haptic.proxy.mass * scene_.haptic.proxy.gravity, generation),
      built_stiffness_(settings.stiffness),
      stress_(settings.stress),
      loops_((scene_.world.setFrictionScale(settings.friction), scene_), timingOf(config),
             [this](const World& world, const VisualRecord& record) { stepped(world, record); }) {
  last_tick_.device.pose = scene_.start;
  last_tick_.proxy = scene_.world.tool().state.handle.pose;
  keepState();
}

void RunningScene::setMethod(const SceneConfig& config) {
  config_ = config;
  scene_.linearization.delassus = delassusOf(config.method);
  loops_.change(renderingOf(config.method), timingOf(config));
}

void RunningScene::setStiffness(double scale) {
  for (int i = 0; i < scene_.world.bodies(); ++i) {
    if (!scene_.world.body(i).model.isRigid()) scene_.world.setStiffnessScale(i, scale / built_stiffness_);
  }
}

void RunningScene::record(Recorder* recorder, RunSink sink) {
  recorder_ = recorder;
  sink_ = std::move(sink);
}

void RunningScene::pump(Audience& audience, std::uint32_t generation, bool again) {
  takeSteps();  // before the ticks, which use their models
  const bool ticked = takeTicks();
  if (!encoder_.empty()) {
    const auto ticks = static_cast<std::uint32_t>(encoder_.ticks());
    audience.samples(share(encoder_.take()), ticks);
  }
  if (ticked || again) sendFrame(audience, generation, again);
}

void RunningScene::takeSteps() {
  VisualRecord step;
  while (loops_.pop(step)) {
    encoder_.add(step, loops_.substeps());
    sink_.visual(step);
    if (recorder_) recorder_->step(step, loops_.substeps());
  }
}

bool RunningScene::takeTicks() {
  TickRecord tick;
  bool any = false;
  while (loops_.pop(tick)) {
    encoder_.add(tick);
    sink_.tick(tick);
    if (recorder_) recorder_->tick(tick);
    last_tick_ = tick;
    any = true;
  }
  return any;
}

void RunningScene::sendFrame(Audience& audience, std::uint32_t generation, bool again) {
  const SceneState* state = states_.read();
  if (state == nullptr) return;
  if (!full_ || state->step != full_step_ || again) {
    full_ = share(frameMessage(*state, last_tick_, mouse_.taken(), generation, true));
    full_step_ = state->step;
  }
  audience.frame(state->step, full_, share(frameMessage(*state, last_tick_, mouse_.taken(), generation, false)));
}

MouseDevice& RunningScene::replaceDevice() {
  auto mouse = buildMouse(config_, scene_.start);
  MouseDevice& out = *mouse;
  if (scene_.device->isReal()) {
    idle_mouse_ = std::move(mouse);
  } else {
    scene_.device = std::move(mouse);
  }
  return out;
}

// On the visual loop's thread, or while it stands still.
void RunningScene::stepped(const World& world, const VisualRecord& record) {
  ++state_.step;
  keepState();
  if (recorder_) recorder_->state(world, record);
}

void RunningScene::keepState() {
  reader_.read(scene_.world, stress_.load(std::memory_order_relaxed), state_);
  states_.write(state_);
}

}  // namespace palpate
