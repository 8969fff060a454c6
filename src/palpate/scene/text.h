#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

/// The known word with the fewest edits (letters inserted, dropped, changed, or two neighbors swapped) from `word`.
/// @param known  not empty
std::string nearestWord(std::string_view word, const std::vector<std::string>& known);

/// Text from outside for use in an error: on one line, without control characters, shortened.
std::string printable(std::string_view text, std::size_t longest = 48);

/// The same in quotation marks.
std::string shownText(std::string_view text, std::size_t longest = 48);

}  // namespace palpate
