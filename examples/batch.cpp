// Many runs over the cores: how the force of a press grows with the stiffness of the cube. Each run is a world of its
// own, so threads share nothing, and the numbers are the same with any number of them.
#include <palpate/palpate.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <thread>
#include <vector>

constexpr const char* kScene = R"(
palpate: 1
name: cube
duration: 0.5
tool:
  shape: {bar: {size: [0.06, 0.06, 0.06], cells: [3, 3, 3]}}
  handles:
    top:
      region: {halfspace: {point: [0, 0, 0.0599], normal: [0, 0, 1]}}
      hand: {keyframes: [{t: 0}, {t: 0.4, position: [0, 0, -0.005]}]}
obstacles: [{name: ground, plane: {point: [0, 0, 0], normal: [0, 0, 1]}}]
)";

namespace {

double lastForce(double modulus) {
  palpate::RunOptions options;
  double force = 0;
  options.tick = [&](const palpate::Tick& t) { force = t.sent[2]; };
  palpate::Scene scene = palpate::Scene::parse(kScene);
  palpate::Run(scene.set("tool.material.youngs_modulus", modulus), options).finish();
  return force;
}

}  // namespace

int main() {
  const std::vector<double> moduli{5e3, 1e4, 2e4, 4e4, 8e4, 1.6e5};
  std::vector<double> forces(moduli.size());
  std::atomic<std::size_t> next{0};
  std::vector<std::thread> threads;
  for (unsigned i = 0; i < std::max(1u, std::thread::hardware_concurrency()); ++i) {
    threads.emplace_back([&] {
      for (std::size_t k = next++; k < moduli.size(); k = next++) forces[k] = lastForce(moduli[k]);
    });
  }
  for (std::thread& t : threads) t.join();
  for (std::size_t k = 0; k < moduli.size(); ++k) std::printf("%7.0f Pa: %.3f N\n", moduli[k], forces[k]);
  return std::is_sorted(forces.begin(), forces.end()) ? 0 : 1;
}
