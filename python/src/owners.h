#pragma once

#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include "arrays.h"
#include "palpate/scene/builder.h"
#include "palpate/session/run_timing.h"
#include "palpate/visual/visual_step.h"

namespace palpate::python {

class ContactsView;

/// A scene as it was built. Views on its memory and what Python calls a body keep it alive.
class WorldOwner : public std::enable_shared_from_this<WorldOwner> {
 public:
  explicit WorldOwner(const SceneConfig& config)
      : built(buildScene(config)), timing(timingOf(config)), target{built.start, Vec6::Zero()} {}

  BuiltScene built;
  RunTiming timing;
  DeviceTarget target;  ///< that the next step takes if it is given none

  World& world() { return built.world; }
  /// Of the last step; the same object until the next one.
  std::shared_ptr<ContactsView> contacts();
  /// Right before a step, and after it. Whoever looks at the contacts of the last one keeps them.
  void beginStep();
  void endStep(const StepReport& report) { stepped_ = !report.failed(); }
  /// The state was set from outside: no step leads to it.
  void wasSet() { stepped_ = false; }
  /// @throws RuntimeError where there is no step to be looked at
  void requireStep() const {
    if (!stepped_) throw std::runtime_error("no step that went well since the world was built or its state was set");
  }

  /// While it lives, no other thread may use the world. @throws RuntimeError if one does
  class Use {
   public:
    explicit Use(WorldOwner& owner) : owner_(owner) {
      if (owner.used_.exchange(true)) throw std::runtime_error("the world is in use by another thread");
    }
    ~Use() { owner_.used_.store(false); }
    Use(const Use&) = delete;
    Use& operator=(const Use&) = delete;

   private:
    WorldOwner& owner_;
  };

 private:
  std::atomic<bool> used_{false};
  bool stepped_ = false;
  std::weak_ptr<ContactsView> contacts_;
};

/// The contacts of one step. As long as it is the world's last step they lie there; then this takes them over, in the
/// same memory, so views on them stay what they were.
class ContactsView {
 public:
  explicit ContactsView(std::shared_ptr<WorldOwner> world) : world_(std::move(world)) {}
  const ContactSet& set() const { return own_ ? *own_ : world_->world().contacts(); }
  void take() { own_ = world_->world().takeContacts(); }

 private:
  std::shared_ptr<WorldOwner> world_;
  std::optional<ContactSet> own_;
};

inline std::shared_ptr<ContactsView> WorldOwner::contacts() {
  std::shared_ptr<ContactsView> view = contacts_.lock();
  if (!view) contacts_ = view = std::make_shared<ContactsView>(shared_from_this());
  return view;
}
inline void WorldOwner::beginStep() {
  if (const auto view = contacts_.lock()) view->take();
  contacts_.reset();
  stepped_ = false;
}

/// One body of a world.
struct BodyView {
  std::shared_ptr<WorldOwner> owner;
  int index = 0;
  Body body() const { return owner->world().body(index); }
};

/// Asks Python whether Ctrl-C was pressed; seldom, as it has to wait for the interpreter. Thread that holds no GIL.
class Interrupts {
 public:
  /// @returns true once it was; the exception is then set
  bool asked() {
    const auto now = Clock::now();
    if (asked_ || now < next_) return asked_;
    next_ = now + std::chrono::milliseconds(50);
    const py::gil_scoped_acquire gil;
    asked_ = PyErr_CheckSignals() != 0;
    return asked_;
  }
  bool happened() const { return asked_; }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point next_ = Clock::now() + std::chrono::milliseconds(50);
  bool asked_ = false;
};

void bindValues(py::module_& module);
void bindWorld(py::module_& module);
void bindHaptics(py::module_& module);
void bindRuns(py::module_& module);

}  // namespace palpate::python
