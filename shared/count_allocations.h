#pragma once

// Counts calls of malloc and its kin, which shared/count_allocations.cpp replaces: for test programs that list it.

#include <atomic>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(__GLIBC__)
#define PALPATE_COUNTS_MALLOC 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define PALPATE_COUNTS_MALLOC 0
#endif
#endif
#ifndef PALPATE_COUNTS_MALLOC
#define PALPATE_COUNTS_MALLOC 1
#endif

namespace palpate::test {

/// False where malloc belongs to a sanitizer: nothing is counted there, and a test of it has to be skipped.
inline constexpr bool kCountsMalloc = PALPATE_COUNTS_MALLOC;

extern std::atomic<bool> counting;  ///< on any thread
extern std::atomic<int> allocations;

/// Allocations while something is done.
template <class Work>
int allocationsIn(const Work& work) {
  allocations = 0;
  counting = true;
  work();
  counting = false;
  return allocations;
}

}  // namespace palpate::test
