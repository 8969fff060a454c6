#pragma once

#include <cstdlib>

#include "palpate/threads/thread_team.h"

namespace palpate {

/// The threads that steps are measured with: as many as the program takes, or PALPATE_BENCH_THREADS.
inline ThreadTeam& benchTeam() {
  static ThreadTeam team([] {
    const char* wanted = std::getenv("PALPATE_BENCH_THREADS");
    return wanted != nullptr ? std::atoi(wanted) : ThreadTeam::suitable();
  }());
  return team;
}

}  // namespace palpate
