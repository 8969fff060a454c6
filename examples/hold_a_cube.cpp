// Hold a soft cube and press it on the ground: a scene from text, run in virtual time.
#include <palpate/palpate.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

constexpr const char* kScene = R"(
palpate: 1
name: cube
duration: 1                                                      # s
tool:
  shape: {bar: {size: [0.06, 0.06, 0.06], cells: [3, 3, 3]}}     # m
  pose: {position: [0, 0, 0.005]}                                # m
  handles:
    top:
      region: {halfspace: {point: [0, 0, 0.0599], normal: [0, 0, 1]}}
      hand: {keyframes: [{t: 0.1}, {t: 0.8, position: [0, 0, -0.015]}]}
obstacles:
  - {name: ground, plane: {point: [0, 0, 0], normal: [0, 0, 1]}}
)";

int main() {
  try {
    palpate::RunOptions options;
    double peak = 0;
    options.tick = [&](const palpate::Tick& t) { peak = std::max(peak, std::abs(t.sent[2])); };
    options.visual = [](const palpate::VisualStep& s) {
      if (s.report.active > 0)
        std::printf("%.3f s: %d contacts, %.2f mm deep\n", s.time, s.report.active, 1e3 * s.report.penetration);
    };
    palpate::Run run(palpate::Scene::parse(kScene), options);
    const palpate::RunSummary summary = run.finish();
    std::printf("%llu ticks, at most %.2f N upwards or downwards\n", static_cast<unsigned long long>(summary.ticks),
                peak);
    return 0;
  } catch (const palpate::InputError& e) {
    std::fprintf(stderr, "%s\n", e.what());  // one line: file, key, cause
    return 2;
  }
}
