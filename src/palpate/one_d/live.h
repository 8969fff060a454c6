#pragma once

#include <deque>

#include "palpate/live/live_tick.h"
#include "palpate/one_d/config.h"

namespace palpate::one_d {

/// Method `live` on the line (docs/live.md): the tool is one mode, the wall one contact. The tick is that of the
/// scenes, its axes across the line idle.
class LiveRun {
 public:
  LiveRun(const Config& config, double visual_dt, double latency);
  /// One haptic tick, and the visual step that begins with it if one does. @returns the force on the device [N]
  double tick(std::size_t tick, const PointState& device);
  /// The newest visual state that has reached the haptic loop.
  const ToolState& shownState() const { return shown_; }

 private:
  struct Message {
    std::size_t arrival = 0;
    ToolState state;
    LiveModel model;
  };
  void takeStep(std::size_t tick);
  LiveModel modelOf(const ToolState& state, std::int64_t index) const;
  PointState handleAt(std::int64_t index) const;

  Parameters parameters_;
  double dt_;
  Timing timing_;
  HandlePath path_;
  ToolState visual_, shown_;
  LiveModel newest_, used_;  // of the last visual step; in the tick
  LiveState state_;
  LiveTick live_tick_;
  Pose pose_;
  Vec6 twist_ = Vec6::Zero();
  std::deque<Message> underway_;
};

}  // namespace palpate::one_d
