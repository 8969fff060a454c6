// Fuzz target: messages from a page are read or refused with InputError, and what is read is sane.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "palpate/common/error.h"
#include "palpate/protocol/commands.h"
#include "palpate/protocol/layout.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const palpate::ViewerCommand command =
        palpate::parseCommand(std::string_view(reinterpret_cast<const char*>(data), size));
    if (const auto* hand = std::get_if<palpate::HandMessage>(&command)) {
      const bool sane = hand->pose.position.allFinite() && std::abs(hand->pose.rotation.norm() - 1.0) < 1e-9;
      if (!sane) std::abort();
    }
    if (const auto* set = std::get_if<palpate::SetMessage>(&command)) {
      if (set->speed &&
          !(*set->speed >= palpate::protocol::kSpeed.low && *set->speed <= palpate::protocol::kSpeed.high))
        std::abort();
      if (set->stiffness && !(*set->stiffness > 0)) std::abort();
    }
  } catch (const palpate::InputError&) {
  }
  return 0;
}
