#include "palpate/scene/text.h"

#include <algorithm>

namespace palpate {
namespace {

/// Edits between two words, optimal string alignment; three rows of the table are enough.
std::size_t editDistance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before_last(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) last[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t change = a[i - 1] == b[j - 1] ? 0 : 1;
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + change});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        row[j] = std::min(row[j], before_last[j - 2] + 1);
    }
    std::swap(before_last, last);
    std::swap(last, row);
  }
  return last[b.size()];
}

}  // namespace

std::string nearestWord(std::string_view word, const std::vector<std::string>& known) {
  const std::string_view start = word.substr(0, 48);
  const auto closer = [&](const std::string& a, const std::string& b) {
    return editDistance(start, a) < editDistance(start, b);
  };
  return *std::min_element(known.begin(), known.end(), closer);
}

std::string printable(std::string_view text, std::size_t longest) {
  std::string result;
  for (const char c : text.substr(0, longest)) {
    const bool shown = static_cast<unsigned char>(c) >= 0x20 && c != 0x7f;
    result += shown ? c : '?';
  }
  return text.size() > longest ? result + "..." : result;
}

std::string shownText(std::string_view text, std::size_t longest) { return '"' + printable(text, longest) + '"'; }

}  // namespace palpate
