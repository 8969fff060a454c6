// In the haptic thread of a whole run: no allocation, no lock, no exception, and no system call but the sleep. What a
// thread may call is set by a filter of the kernel's, which the device installs from within a tick.
#include <dlfcn.h>
#include <gtest/gtest.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <pthread.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <ucontext.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "palpate/scene/reader.h"
#include "palpate/session/realtime_loops.h"
#include "shared/count_allocations.h"

namespace {

thread_local bool trapped = false;  // this thread, now
std::atomic<int> allocations{0}, locks{0}, throws{0}, calls{0}, last_call{-1};

void count(std::atomic<int>& what) {
  if (trapped) ++what;
}

}  // namespace

#if PALPATE_COUNTS_MALLOC && defined(__x86_64__)
#define PALPATE_TRAPS 1

extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void __libc_free(void*);

void* malloc(std::size_t size) {
  count(allocations);
  return __libc_malloc(size);
}
void* calloc(std::size_t number, std::size_t size) {
  count(allocations);
  return __libc_calloc(number, size);
}
void* realloc(void* memory, std::size_t size) {
  count(allocations);
  return __libc_realloc(memory, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  count(allocations);
  return __libc_memalign(alignment, size);
}
void free(void* memory) {
  if (memory != nullptr) count(allocations);
  __libc_free(memory);
}
int pthread_mutex_lock(pthread_mutex_t* mutex) {
  using Real = int (*)(pthread_mutex_t*);
  static Real real = nullptr;
  if (real == nullptr) real = reinterpret_cast<Real>(dlsym(RTLD_NEXT, "pthread_mutex_lock"));
  count(locks);
  return real(mutex);
}
void* __cxa_allocate_exception(std::size_t size) noexcept {
  using Real = void* (*)(std::size_t);
  static Real real = nullptr;
  if (real == nullptr) real = reinterpret_cast<Real>(dlsym(RTLD_NEXT, "__cxa_allocate_exception"));
  count(throws);
  return real(size);
}
}
#else
#define PALPATE_TRAPS 0
#endif

namespace palpate {
namespace {

#if PALPATE_TRAPS
void onCall(int, siginfo_t* info, void* context) {
  ++calls;
  last_call = info->si_syscall;
  static_cast<ucontext_t*>(context)->uc_mcontext.gregs[REG_RAX] = -ENOSYS;
}

// From here on this thread gets SIGSYS in place of any other call. Those after the clock's are made by the end of a
// thread; a clock of a machine that cannot tell the time without the kernel is one, too.
bool allowOnlySleep() {
  constexpr int kAllowed[] = {SYS_clock_nanosleep, SYS_clock_gettime, SYS_rt_sigreturn,   SYS_close, SYS_madvise,
                              SYS_munmap,          SYS_exit,          SYS_rt_sigprocmask, SYS_rseq,  SYS_exit_group};
  constexpr int kCount = static_cast<int>(std::size(kAllowed));
  sock_filter program[kCount + 3];
  program[0] = BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr));
  for (int i = 0; i < kCount; ++i) {
    program[i + 1] = BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<unsigned>(kAllowed[i]),
                              static_cast<unsigned char>(kCount - i), 0);
  }
  program[kCount + 1] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_TRAP);
  program[kCount + 2] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW);
  sock_fprog whole{kCount + 3, program};
  return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &whole) == 0;
}

/// Watches the thread from the tick at `from` up to that at `until`; in between it may do something that is not
/// allowed.
class Trap final : public Device {
 public:
  Trap(std::unique_ptr<Device> real, void (*misdeed)()) : real_(std::move(real)), misdeed_(misdeed) {}
  const char* name() const noexcept override { return "trap"; }
  DeviceLimits limits() const noexcept override { return real_->limits(); }
  void begin(const Vec6& wrench) noexcept override { real_->begin(wrench); }
  DeviceState sample(double t) noexcept override {
    if (t >= 0.1 && !set_) {
      set_ = true;
      // what a thread's first ones set up, so that a misdeed is one and no more
      void* volatile memory = std::malloc(9);
      std::free(memory);
      try {
        throw 1;
      } catch (int) {
      }
      granted = allowOnlySleep();
      trapped = true;
    }
    if (t >= 1.0) trapped = false;
    if (trapped) ++ticks;
    if (misdeed_ != nullptr && ticks == 50) std::exchange(misdeed_, nullptr)();
    return real_->sample(t);
  }
  void apply(const Vec6& wrench, double t, double dt) noexcept override { real_->apply(wrench, t, dt); }
  bool granted = false;
  int ticks = 0;

 private:
  std::unique_ptr<Device> real_;
  void (*misdeed_)();
  bool set_ = false;
};

struct Counts {
  bool granted;
  int ticks, allocations, locks, throws, calls;
};

Counts trappedRun(const std::string& method, double haptic_step, void (*misdeed)() = nullptr) {
  struct sigaction action = {};
  action.sa_sigaction = onCall;
  action.sa_flags = SA_SIGINFO;
  sigaction(SIGSYS, &action, nullptr);
  allocations = locks = throws = calls = 0;
  SceneConfig config = readScene(std::string(PALPATE_SOURCE_DIR) + "/scenes/cube.yaml");
  config.device = {};
  config.duration = 1.1;
  config.haptic_step = haptic_step;
  config.method = method == "live" ? MethodName::live : method == "hsl" ? MethodName::hsl : MethodName::vc;
  BuiltScene scene = buildScene(config);
  auto trap = std::make_unique<Trap>(std::move(scene.device), misdeed);
  const Trap& seen = *trap;
  scene.device = std::move(trap);
  runRealtime(scene, timingOf(config), {});
  return {seen.granted, seen.ticks, allocations, locks, throws, calls};
}

TEST(TickTrap, NothingButSleepInATick) {
  for (const char* method : {"live", "hsl", "vc"}) {
    for (const double step : {0.001, 0.00025}) {
      const Counts counts = trappedRun(method, step);
      if (!counts.granted) GTEST_SKIP() << "the system grants no filter";
      EXPECT_GT(counts.ticks, 200);
      EXPECT_EQ(counts.allocations, 0) << method << ' ' << step;
      EXPECT_EQ(counts.locks, 0) << method << ' ' << step;
      EXPECT_EQ(counts.throws, 0) << method << ' ' << step;
      EXPECT_EQ(counts.calls, 0) << method << ' ' << step << ": number " << last_call;
    }
  }
}

// And that each would be seen.
TEST(TickTrap, SeesWhatIsNotAllowed) {
  Counts counts = trappedRun("hsl", 0.001, [] {
    void* volatile memory = std::malloc(9);
    std::free(memory);
  });
  if (!counts.granted) GTEST_SKIP() << "the system grants no filter";
  EXPECT_GE(counts.allocations, 1);
  counts = trappedRun("hsl", 0.001, [] {
    static std::mutex mutex;
    const std::lock_guard<std::mutex> lock(mutex);
  });
  EXPECT_EQ(counts.locks, 1);
  counts = trappedRun("hsl", 0.001, [] {
    try {
      throw 1;
    } catch (int) {
    }
  });
  EXPECT_GE(counts.throws, 1);
  counts = trappedRun("hsl", 0.001, [] { syscall(SYS_getppid); });
  EXPECT_EQ(counts.calls, 1);
}
#else
TEST(TickTrap, NeedsItsOwnMalloc) { GTEST_SKIP() << "malloc belongs to a sanitizer here"; }
#endif

}  // namespace
}  // namespace palpate
