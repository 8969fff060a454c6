#pragma once

namespace palpate {

inline constexpr double kDt = 0.001;  ///< haptic step of the tests of haptics and devices [s]

}  // namespace palpate
