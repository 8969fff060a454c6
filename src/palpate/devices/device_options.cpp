#include "palpate/devices/device_options.h"

#include <charconv>
#include <cmath>

#include <fmt/format.h>

#include "palpate/common/error.h"

namespace palpate {
namespace {

[[noreturn]] void fail(const std::string& key, const std::string& cause) {
  throw InputError("option of the device", key, cause);
}

}  // namespace

std::string DeviceOptions::text(const std::string& key, const std::string& otherwise) const {
  const auto found = values_.find(key);
  return found == values_.end() ? otherwise : found->second;
}

double DeviceOptions::number(const std::string& key, double otherwise, double low, double high) const {
  const auto found = values_.find(key);
  if (found == values_.end()) return otherwise;
  const std::string& text = found->second;
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !(value >= low && value <= high)) {
    fail(key, fmt::format("must be a number from {:g} to {:g}", low, high));
  }
  return value;
}

bool DeviceOptions::flag(const std::string& key, bool otherwise) const {
  const std::string value = text(key, otherwise ? "yes" : "no");
  if (value == "yes" || value == "true") return true;
  if (value == "no" || value == "false") return false;
  fail(key, "must be yes or no");
}

DeviceOptions DeviceOptions::parse(const std::string& text) {
  DeviceOptions out;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    const std::string item = text.substr(at, end - at);
    const std::size_t equals = item.find('=');
    if (equals == 0 || equals == std::string::npos || equals + 1 == item.size()) {
      fail("", "write NAME:key=value,key=value");
    }
    if (!out.values_.emplace(item.substr(0, equals), item.substr(equals + 1)).second) {
      fail(item.substr(0, equals), "is given twice");
    }
    at = end + 1;
  }
  return out;
}

std::string DeviceOptions::string() const {
  std::string out;
  for (const auto& [key, value] : values_) out += (out.empty() ? "" : ",") + key + "=" + value;
  return out;
}

}  // namespace palpate
