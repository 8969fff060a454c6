// Fuzz target: what a Haply service says is read or refused, and what is read is sane.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "palpate/devices/inverse3_messages.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  palpate::Inverse3State state;
  palpate::readInverse3State(text, "", state);
  palpate::readInverse3State(text, "04EA", state);
  if (!state.position.allFinite() || !state.velocity.allFinite() || std::abs(state.rotation.norm() - 1.0) > 1e-6) {
    std::abort();
  }
  palpate::readInverse3Inventory(text);
  palpate::readInverse3Event(text);
  palpate::spellingOf(palpate::readServiceVersion(text));
  return 0;
}
