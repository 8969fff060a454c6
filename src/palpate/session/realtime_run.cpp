#include <chrono>
#include <thread>

#include "palpate/session/realtime_loops.h"

namespace palpate {

RunOutcome runRealtime(BuiltScene& scene, const RunTiming& timing, const RunSink& sink) {
  RealtimeLoops loops(scene, timing, sink.stepped);
  loops.start(1.0, timing.duration);
  TickRecord tick;
  VisualRecord step;
  for (bool last = false;;) {
    while (loops.pop(step)) sink.visual(step);
    while (loops.pop(tick)) {
      sink.tick(tick);
      sink.progress(tick.time / timing.duration);
    }
    if (last) break;
    last = loops.ended();
    if (!last) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  loops.stop();
  sink.progress(1.0);
  return loops.outcome();
}

}  // namespace palpate
