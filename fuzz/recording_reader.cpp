// Any bytes as a recorded run: what is accepted is exported, to memory.
#include <cstddef>
#include <cstdint>
#include <memory>
#include <sstream>
#include <string>

#include "palpate/common/error.h"
#include "palpate/exports/recorded_run.h"
#include "palpate/exports/run_series.h"
#include "palpate/mesh/vtu_file.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  try {
    palpate::RecordedRun run(std::make_unique<std::istringstream>(bytes), "fuzz");
    std::vector<std::size_t> all;
    for (std::size_t b = 0; b < run.bodies().size(); ++b) all.push_back(b);
    for (std::size_t i = 0; i < run.times().size() && i < 3; ++i) {
      const palpate::RecordedFrame frame = run.frame(i);
      palpate::vtuBytes(palpate::meshGrid(run, all, &frame));
      palpate::surfaceAt(run, all, &frame);
    }
    run.at(run.times().back() / 2);
  } catch (const palpate::InputError&) {
    // The one way in which bad input may end.
  }
  return 0;
}
