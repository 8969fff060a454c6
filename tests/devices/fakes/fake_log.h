#pragma once

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <set>
#include <string>

namespace fake {

/// What a fake library is told by the environment, and what it writes down: PALPATE_FAKE_FAULT="name@seconds,name",
/// PALPATE_FAKE_LOG=file. Seconds count from the first force above 0.2 N.
class Log {
 public:
  explicit Log(const char* program) : program_(program) {}

  bool has(const char* fault) const { return at(fault) >= 0; }
  /// The fault's time has come.
  bool on(const char* fault, double since) const {
    const double when = at(fault);
    return when >= 0 && since >= when;
  }
  void violation(const std::string& what) {
    const std::lock_guard lock(mutex_);
    violations_.insert(what);
    write();
  }
  void force(double x, double y, double z, bool in_effect) {
    const std::lock_guard lock(mutex_);
    const double norm = std::sqrt(x * x + y * y + z * z);
    if (!std::isfinite(norm)) {
      violations_.insert("a force that is no number");
      return;
    }
    const double dx = x - last_[0], dy = y - last_[1], dz = z - last_[2];
    step_ = std::max(step_, std::sqrt(dx * dx + dy * dy + dz * dz));
    last_[0] = x, last_[1] = y, last_[2] = z;
    max_ = std::max(max_, norm);
    zeros_ = norm == 0 ? zeros_ + 1 : 0;
    ++forces_;
    if (!in_effect && norm > 0) ++away_;
  }
  /// The firmware's watchdog had no force for its time.
  void starved() {
    const std::lock_guard lock(mutex_);
    ++starved_;
  }
  void called(const char* what) {
    const std::lock_guard lock(mutex_);
    if (!calls_.empty()) calls_ += ",";
    calls_ += "\"" + std::string(what) + "\"";
  }
  void write() const {
    const char* file = std::getenv("PALPATE_FAKE_LOG");
    if (file == nullptr) return;
    std::FILE* out = std::fopen(file, "w");
    if (out == nullptr) return;
    std::fprintf(out, "{\"program\":\"%s\",\"violations\":[", program_);
    const char* comma = "";
    for (const std::string& v : violations_) {
      std::fprintf(out, "%s\"%s\"", comma, v.c_str());
      comma = ",";
    }
    std::fprintf(out,
                 "],\"forces\":%ld,\"max_force\":%g,\"largest_step\":%g,\"last_force\":[%g,%g,%g],\"last_zeros\":%ld,"
                 "\"non_zero_while_away\":%ld,\"starved\":%ld,\"calls\":[%s]}\n",
                 forces_, max_, step_, last_[0], last_[1], last_[2], zeros_, away_, starved_, calls_.c_str());
    std::fclose(out);
  }
  void finish() {
    const std::lock_guard lock(mutex_);
    write();
  }

 private:
  // Time of a fault [s]; below 0: it is not wanted.
  double at(const char* fault) const {
    const char* wanted = std::getenv("PALPATE_FAKE_FAULT");
    const std::size_t size = std::strlen(fault);
    while (wanted != nullptr && *wanted != 0) {
      const char* end = std::strchr(wanted, ',');
      const std::size_t length = end ? static_cast<std::size_t>(end - wanted) : std::strlen(wanted);
      if (length >= size && std::strncmp(wanted, fault, size) == 0 && (length == size || wanted[size] == '@')) {
        return length == size ? 0.0 : std::atof(wanted + size + 1);
      }
      wanted = end ? end + 1 : nullptr;
    }
    return -1.0;
  }

  const char* program_;
  mutable std::mutex mutex_;
  std::set<std::string> violations_;
  std::string calls_;
  double last_[3] = {0, 0, 0}, max_ = 0, step_ = 0;
  long forces_ = 0, zeros_ = 0, away_ = 0, starved_ = 0;
};

}  // namespace fake
