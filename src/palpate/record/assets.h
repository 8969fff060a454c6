#pragma once

#include <cstddef>
#include <string_view>

/// Texts built into the program that every report carries inside itself, so that it works offline.
namespace palpate::assets {

std::string_view reportCss();       ///< assets/report.css
std::string_view reportJs();        ///< assets/report.js
std::string_view dygraphCss();      ///< of the package libjs-dygraphs
std::string_view dygraphJs();       ///< of the package libjs-dygraphs
std::string_view dygraphLicense();  ///< of the package libjs-dygraphs

}  // namespace palpate::assets
