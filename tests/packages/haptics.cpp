// Of somebody who embeds the haptic loop.
#include <palpate/haptics.h>

#include <cstdio>

int main() {
  palpate::HapticLoop loop({});
  loop.start({}, {}, 0);
  palpate::HandleModel model;
  model.force[2] = 0.5;
  palpate::Tick tick;
  for (int k = 0; k < 500; ++k) {
    model.time = 0.001 * k;
    tick = loop.tick({}, &model, 0.001 * k);
  }
  std::printf("palpate %s: %.3f N\n", palpate::version(), tick.sent[2]);
  return tick.sent[2] < 0.02 && tick.sent[2] > 0.0 ? 0 : 1;  // 0.5 N less the weight of the proxy, 50 g
}
