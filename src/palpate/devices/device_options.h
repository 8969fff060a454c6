#pragma once

#include <map>
#include <string>
#include <vector>

namespace palpate {

/// Settings of a device by name, as text: `device: options:` of a scene, `--device NAME:key=value,key=value`.
class DeviceOptions {
 public:
  DeviceOptions() = default;
  explicit DeviceOptions(std::map<std::string, std::string> values) : values_(std::move(values)) {}

  bool has(const std::string& key) const { return values_.contains(key); }
  std::string text(const std::string& key, const std::string& otherwise) const;
  /// @throws InputError for what is no number, or not from low to high
  double number(const std::string& key, double otherwise, double low, double high) const;
  /// yes or no. @throws InputError
  bool flag(const std::string& key, bool otherwise) const;
  const std::map<std::string, std::string>& values() const { return values_; }
  bool operator==(const DeviceOptions&) const = default;

  /// From "key=value,key=value". @throws InputError
  static DeviceOptions parse(const std::string& text);
  /// The same back.
  std::string string() const;

 private:
  std::map<std::string, std::string> values_;
};

/// One option, for help.
struct DeviceOption {
  const char* key;
  const char* what;  ///< meaning, unit, default
};

}  // namespace palpate
