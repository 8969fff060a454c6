#pragma once

#include <vector>

#include "palpate/viewer/server.h"

namespace palpate {

/// The page's files, which are part of the program.
std::vector<StaticFile> pageFiles();

}  // namespace palpate
