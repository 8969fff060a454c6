// Any bytes as a scene: either a config or an InputError whose message is one line, and nothing else.

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "palpate/common/error.h"
#include "palpate/scene/overrides.h"
#include "palpate/scene/reader.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try {
    palpate::SceneConfig scene = palpate::readSceneFromString(text, "fuzz.yaml");
    if (!(scene.duration > 0.0) || scene.ticksPerStep() < 1 || scene.tool.chosenHandle().name.empty()) std::abort();
    palpate::applyOverrides(scene, {});
  } catch (const palpate::InputError& error) {
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
  return 0;
}
