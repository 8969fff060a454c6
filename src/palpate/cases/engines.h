#pragma once

#include <filesystem>
#include <string>

namespace palpate {

/// Scripts that run the cases of a planned study on several machines: slurm.sh, parallel.sh, Snakefile.
void writeEngines(const std::filesystem::path& folder, const std::string& name, int cases);

}  // namespace palpate
