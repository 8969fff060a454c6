#pragma once

#include "palpate/haptics/haptic_loop.h"
#include "palpate/linearization/linearize.h"
#include "palpate/scene/config.h"

namespace palpate {

// What a method is to the two loops.

inline Rendering renderingOf(MethodName method) {
  switch (method) {
    case MethodName::live:
      return Rendering::live;
    case MethodName::vc:
      return Rendering::virtual_coupling;
    default:
      return Rendering::linearized;
  }
}
inline DelassusModel delassusOf(MethodName method) {
  return method == MethodName::hsl_exact ? DelassusModel::exact : DelassusModel::diagonal;
}

}  // namespace palpate
