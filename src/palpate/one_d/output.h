#pragma once

#include <filesystem>
#include <string>

#include "palpate/one_d/experiment.h"

namespace palpate::one_d {

/// Writes one_d.csv, report.html and summary.json (see docs/files.md) into the folder, all of them or none.
/// @throws InputError if the folder cannot be made or written to, RunError if writing fails
void writeResults(const Results& results, const std::filesystem::path& folder);

/// The table of drag and errors as text for a terminal.
std::string tableText(const Results& results);

}  // namespace palpate::one_d
