// Fuzz target: the reader of recorded motions accepts or throws InputError, and what it accepts is sane.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "palpate/common/error.h"
#include "palpate/devices/motion_recording.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const auto recording =
        palpate::parseMotion(std::string_view(reinterpret_cast<const char*>(data), size), "motion.csv");
    double last = -INFINITY;
    for (const auto& sample : recording.samples) {
      const bool sane = sample.time > last && std::isfinite(sample.time) && sample.state.pose.position.allFinite() &&
                        std::abs(sample.state.pose.rotation.norm() - 1.0) < 1e-9 && sample.state.twist.allFinite();
      if (!sane) std::abort();
      last = sample.time;
    }
  } catch (const palpate::InputError&) {
  }
  return 0;
}
