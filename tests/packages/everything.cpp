// Of somebody who runs scenes.
#include <palpate/palpate.h>

#include <cstdio>

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  try {
    palpate::Scene scene = palpate::Scene::load(argv[1]);
    scene.set("duration", 0.2);
    const palpate::RunSummary summary = palpate::Run(scene).finish();
    std::printf("%s: %d ticks\n", scene.name().c_str(), static_cast<int>(summary.ticks));
    scene.set("tool.material.density", -1);
    return 1;
  } catch (const palpate::InputError& e) {
    std::printf("%s\n", e.what());
    return e.key() == "tool.material.density" ? 0 : 1;
  }
}
