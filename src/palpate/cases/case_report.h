#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace palpate {

/// What a study has come to.
struct StudyState {
  std::string name;
  int cases = 0, done = 0;
  std::vector<int> missing;
  std::vector<std::pair<int, std::string>> failed;  ///< with their causes
  std::vector<int> below;                           ///< done; what they looked at is not as it must be
  bool complete() const { return done == cases; }
};

/// Collects what a study's cases left, and writes into its folder:
///
///     table.csv     all numbers, a row for each run that a case reports
///     table.md      the main ones, to be read
///     report.html   the same as a page, with plots over what the study varies
///     summary.json  how the cases stand, and all rows
///     timings.csv   what differs from run to run
///
/// All but timings.csv depends on the results alone. @throws InputError where the folder holds no planned study
StudyState reportStudy(const std::filesystem::path& folder);

/// "1, 3 to 7, 9".
std::string numbersText(const std::vector<int>& numbers);

}  // namespace palpate
