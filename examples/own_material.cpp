// A scene built in code, with a material of its own: a soft block with a stiff core, from a template whose values are
// set by their keys. How stiff it feels follows from K, without a step: the stiffness under a uniform squeeze.
#include <palpate/palpate.h>

#include <cstdio>
#include <string>

namespace {

palpate::Scene block(double modulus, double core_modulus) {
  palpate::Scene scene = palpate::Scene::parse(R"(
palpate: 1
name: block
tool:
  shape: {bar: {size: [0.06, 0.06, 0.06], cells: [4, 4, 4]}}
  handles: {top: {region: {halfspace: {point: [0, 0, 0.0599], normal: [0, 0, 1]}}}}
)");
  scene.set("tool.material.youngs_modulus", modulus).set("tool.material.poisson_ratio", 0.4);
  scene.set("tool.material.parts",
            "[{region: {box: {min: [-0.016, -0.016, 0.014], max: [0.016, 0.016, 0.046]}}, youngs_modulus: " +
                std::to_string(core_modulus) + "}]");
  return scene;
}

/// u^T K u for the displacement u = z of the free nodes: twice the energy of a squeeze by 1, about the ground [N m].
double squeezeStiffness(const palpate::World& world) {
  const palpate::BlockMatrix k = world.stiffness(0);
  const auto x = world.positions(0);
  const auto free = world.freeNodes(0);
  double sum = 0;
  for (int row = 0; row < k.rows; ++row) {
    for (int b = k.begin[row]; b < k.begin[row + 1]; ++b) {
      const double zz = k.value[9 * b + 8] * x[3 * free[row] + 2] * x[3 * free[k.column[b]] + 2];
      sum += k.column[b] == row ? zz : 2 * zz;  // the upper triangle stands for both
    }
  }
  return sum;
}

}  // namespace

int main() {
  double before = 0;
  for (const double core : {2e4, 6e4, 2e5}) {
    const palpate::World world(block(2e4, core));
    const double stiffness = squeezeStiffness(world);
    std::printf("core of %6.0f Pa: %.3f N m\n", core, stiffness);
    if (stiffness <= before) return 1;
    before = stiffness;
  }
  return 0;
}
