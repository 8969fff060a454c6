#pragma once

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <functional>
#include <string>
#include <vector>

namespace palpate::rivals {

/// Time of this thread on a processor [s]: other programs on a busy machine do not count.
inline double processorTime() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

inline double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

struct Candidate {
  std::function<void()> prepare;  ///< not timed
  std::function<void()> run;
};

/// Runs the candidates in turn, `rounds` times after one that does not count. Median time of each [s].
inline std::vector<double> alternate(const std::vector<Candidate>& candidates, int rounds) {
  std::vector<std::vector<double>> times(candidates.size());
  for (int round = -1; round < rounds; ++round)
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      if (candidates[i].prepare) candidates[i].prepare();
      const double start = processorTime();
      candidates[i].run();
      if (round >= 0) times[i].push_back(processorTime() - start);
    }
  std::vector<double> medians;
  for (auto& t : times) medians.push_back(median(std::move(t)));
  return medians;
}

/// Three digits.
inline std::string digits(double value) {
  char text[32];
  std::snprintf(text, sizeof text, value >= 100 ? "%.0f" : value >= 10 ? "%.1f" : value >= 1 ? "%.2f" : "%.3f", value);
  return text;
}

/// A time in milliseconds, and in parentheses how many times that of `base` it is.
inline std::string against(double time, double base) { return digits(1e3 * time) + " (" + digits(time / base) + ")"; }

}  // namespace palpate::rivals
