#include <chrono>
#include <exception>
#include <string>
#include <thread>

#include "palpate/session/realtime_loops.h"

namespace palpate {

RunOutcome runRealtime(BuiltScene& scene, const RunTiming& timing, const RunSink& sink) {
  RealtimeLoops loops(scene, timing, sink.stepped);
  loops.start(1.0, timing.duration);
  TickRecord tick;
  VisualRecord step;
  bool stopped = false;
  std::string failure;
  for (bool last = false;;) {
    while (loops.pop(step)) sink.visual(step);
    while (loops.pop(tick)) {
      sink.tick(tick);
      sink.progress(tick.time / timing.duration);
    }
    if (last) break;
    if (failure.empty() && scene.device->failure() != nullptr) {
      failure = scene.device->failure();
      loops.askToEnd();
    }
    if (!stopped && sink.stopped()) {
      stopped = true;
      loops.askToEnd();
    }
    last = loops.ended();
    if (!last) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  try {
    loops.stop();
  } catch (const std::exception& e) {  // of a visual step: what there is can be written all the same
    failure = e.what();
  }
  sink.progress(1.0);
  RunOutcome out = loops.outcome();
  out.stopped = stopped;
  out.failure = failure;
  return out;
}

}  // namespace palpate
