#pragma once

#include <stdexcept>
#include <string>

namespace palpate {

/// Bad input from outside (scene file, mesh file, command line, recorded motion). The program prints what() as one line
/// on standard error and exits with code 2.
class InputError : public std::runtime_error {
 public:
  /// @param file   file or option that is wrong, e.g. "scenes/alien.yaml" or "--duration"
  /// @param key    place in it, e.g. "tool.material.density" or "line 12"; may be empty
  /// @param cause  what is wrong, and what would be right
  InputError(const std::string& file, const std::string& key, const std::string& cause)
      : std::runtime_error(file + (key.empty() ? "" : ": " + key) + ": " + cause),
        file_(file),
        key_(key),
        cause_(cause) {}

  const std::string& file() const noexcept { return file_; }
  const std::string& key() const noexcept { return key_; }
  const std::string& cause() const noexcept { return cause_; }

 private:
  std::string file_, key_, cause_;
};

/// A run that failed although its input was good (solver gave up, device lost). Exit code 1.
class RunError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace palpate
