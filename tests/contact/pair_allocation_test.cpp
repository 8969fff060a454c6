// Finding pairs must not allocate once it has seen the like. Counts calls of malloc itself.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>

#include "palpate/contact/surface_pairs.h"
#include "surface_motions.h"

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

namespace {
std::atomic<bool> counting{false};
std::atomic<int> allocations{0};

[[maybe_unused]] void count() {
  if (counting.load(std::memory_order_relaxed)) allocations.fetch_add(1, std::memory_order_relaxed);
}
}  // namespace

#if PALPATE_COUNTS_MALLOC
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t size) {
  count();
  return __libc_malloc(size);
}
void* calloc(std::size_t number, std::size_t size) {
  count();
  return __libc_calloc(number, size);
}
void* realloc(void* memory, std::size_t size) {
  count();
  return __libc_realloc(memory, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  count();
  return __libc_memalign(alignment, size);
}
}
#endif

namespace palpate {
namespace {

TEST(SurfacePairsAllocation, NoneInSteadyState) {
  if (PALPATE_COUNTS_MALLOC == 0) GTEST_SKIP() << "malloc belongs to the sanitizer";
  CollisionSurface a(sphereSurface(0.03, 4)), b(sphereSurface(0.03, 4));
  const SelfExclusion exclusion;
  SurfacePairFinder finder;
  std::vector<FeaturePair> pairs;
  size_t found = 0;
  const auto step = [&](int i) {
    const double x = 1e-4 * (i % 7), y = 0.06 * (i % 3);  // rest, impact, throw
    place(b, affine(Mat3::Identity(), Vec3(x, 0, 0.0602)), affine(Mat3::Identity(), Vec3(-x, 0, 0.0601 - y)));
    a.refit();
    pairs.clear();
    finder.find(a, b, 1e-3, pairs);
    finder.findSelf(a, exclusion, 1e-3, pairs);
    found += pairs.size();
  };
  for (int i = 0; i < 21; ++i) step(i);
  found = 0;
  allocations = 0;
  counting = true;
  for (int i = 0; i < 21; ++i) step(i);
  counting = false;
  EXPECT_GT(found, 100u);
  EXPECT_EQ(allocations, 0);
  counting = true;
  auto* probe = new std::vector<int>(100);  // the counter does count
  counting = false;
  delete probe;
  EXPECT_GE(allocations, 2);
}

}  // namespace
}  // namespace palpate
