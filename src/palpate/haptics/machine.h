#pragma once

#include <string>
#include <vector>

#include "palpate/haptics/realtime.h"

namespace palpate {

/// What on this machine keeps a loop of a kilohertz from its deadlines, each with what to do about it; empty: nothing
/// that is known. Looks at what the loop was granted and into /proc and /sys, below `root` (for tests).
std::vector<std::string> realtimeAdvice(const RealtimeGrant& grant, bool awake, const std::string& root = "");

}  // namespace palpate
