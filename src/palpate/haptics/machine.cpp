#include "palpate/haptics/machine.h"

#include <fstream>
#include <iterator>
#include <thread>

namespace palpate {
namespace {

// Empty where there is no such file.
std::string contentOf(const std::string& path) {
  std::ifstream stream(path);
  std::string text{std::istreambuf_iterator<char>(stream), {}};
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  return text;
}

}  // namespace

std::vector<std::string> realtimeAdvice(const RealtimeGrant& grant, bool awake, const std::string& root) {
  std::vector<std::string> out;
  if (!grant.scheduled) {
    out.push_back(
        "no real-time priority: add \"@realtime - rtprio 90\" to /etc/security/limits.d/realtime.conf, yourself to the "
        "group realtime, and log in anew");
  }
  if (!grant.memory_locked) {
    out.push_back("memory may be swapped out: add \"@realtime - memlock unlimited\" to the same file");
  }
  if (!awake) {
    out.push_back(
        "cores may sleep deeply: let the group write /dev/cpu_dma_latency (udev: KERNEL==\"cpu_dma_latency\", "
        "GROUP=\"realtime\", MODE=\"0660\")");
  }
  const std::string kernel = contentOf(root + "/proc/version");
  if (contentOf(root + "/sys/kernel/realtime") != "1" && kernel.find("PREEMPT_RT") == std::string::npos) {
    out.push_back("the kernel is not PREEMPT_RT, so its own work may delay a tick: apt install linux-image-rt-amd64");
  }
  const std::string governor = contentOf(root + "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
  if (!governor.empty() && governor != "performance") {
    out.push_back("processor frequency is \"" + governor + "\": cpupower frequency-set --governor performance");
  }
  const std::string throttled = contentOf(root + "/proc/sys/kernel/sched_rt_runtime_us");
  if (grant.scheduled && throttled == "0") {
    out.push_back("real-time threads get no time: sysctl kernel.sched_rt_runtime_us=950000");
  }
  if ((" " + contentOf(root + "/proc/cpuinfo")).find(" hypervisor") != std::string::npos) {
    out.push_back("this is a virtual machine: its host may take the cores away at any time");
  }
  if (std::thread::hardware_concurrency() < 2) {
    out.push_back("there is one core only: the visual loop waits while the haptic one works, and both wait for others");
  }
  return out;
}

}  // namespace palpate
