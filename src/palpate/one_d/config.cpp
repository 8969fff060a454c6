#include "palpate/one_d/config.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <set>
#include <sstream>
#include <utility>

#include "palpate/common/error.h"

namespace palpate::one_d {

namespace {

constexpr std::size_t kMaxFileBytes = 1 << 20;
constexpr std::size_t kMaxKnots = 100000;
constexpr double kMaxRows = 5e6;  ///< ticks times runs: bounds time, memory and the size of one_d.csv

/// Shortest text that reads back as the same number.
std::string text(double value) {
  char buffer[32];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, value).ptr;
  return {buffer, end};
}

std::size_t editDistance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replace = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, replace});
    }
  }
  return row.back();
}

/// A key or value as it may appear in a one-line message.
std::string printable(const std::string& raw) {
  std::string shown;
  for (const char c : raw.substr(0, 60)) shown += std::iscntrl(static_cast<unsigned char>(c)) ? '?' : c;
  if (raw.size() > 60) shown += "...";
  return shown;
}

/// Reads nodes and turns whatever is wrong with them into an InputError.
class Reader {
 public:
  explicit Reader(std::string file) : file_(std::move(file)) {}

  [[noreturn]] void fail(const std::string& key, const std::string& cause) const {
    throw InputError(file_, key, cause);
  }

  double number(const YAML::Node& node, const std::string& key) const {
    if (!node.IsScalar()) fail(key, "must be a number");
    const std::string& scalar = node.Scalar();
    const char* begin = scalar.data();
    const char* end = begin + scalar.size();
    if (begin != end && *begin == '+') ++begin;
    double value = 0.0;
    const auto [stop, status] = std::from_chars(begin, end, value);
    if (status != std::errc() || stop != end || begin == end) {
      fail(key, "must be a finite number, not '" + printable(scalar) + "'");
    }
    if (!std::isfinite(value)) fail(key, "must be finite, not " + printable(scalar));
    return value;
  }

  std::vector<double> numbers(const YAML::Node& node, const std::string& key) const {
    std::vector<double> values;
    for (const auto& item : list(node, key)) values.push_back(number(item, element(key, values.size())));
    return values;
  }

  std::vector<Knot> knots(const YAML::Node& node, const std::string& key) const {
    std::vector<Knot> values;
    for (const auto& item : list(node, key)) {
      const std::string here = element(key, values.size());
      if (!item.IsSequence() || item.size() != 2) fail(here, "must be a pair [time in s, position in m]");
      values.push_back({number(item[0], here), number(item[1], here)});
    }
    return values;
  }

  std::vector<Method> methods(const YAML::Node& node, const std::string& key) const {
    std::vector<Method> values;
    for (const auto& item : list(node, key)) {
      const std::string name = item.IsScalar() ? item.Scalar() : "";
      if (name != "vc" && name != "hsl") {
        fail(element(key, values.size()), "must be vc or hsl, not '" + printable(name) + "'");
      }
      values.push_back(name == "vc" ? Method::kVc : Method::kHsl);
    }
    return values;
  }

 private:
  static std::string element(const std::string& key, std::size_t index) {
    return key + "[" + std::to_string(index) + "]";
  }

  const YAML::Node& list(const YAML::Node& node, const std::string& key) const {
    if (!node.IsSequence()) fail(key, "must be a list");
    if (node.size() > kMaxKnots) fail(key, "has more than " + std::to_string(kMaxKnots) + " entries");
    return node;
  }

  std::string file_;
};

using Setter = std::function<void(const Reader&, const YAML::Node&, const std::string&, Config&)>;

Setter scalar(double Parameters::*member) {
  return [member](const Reader& reader, const YAML::Node& node, const std::string& key, Config& config) {
    config.parameters.*member = reader.number(node, key);
  };
}

/// Every key that a configuration may have, in the order of the documentation.
const std::vector<std::pair<std::string, Setter>>& knownKeys() {
  static const std::vector<std::pair<std::string, Setter>> keys{
      {"handle_mass", scalar(&Parameters::handle_mass)},
      {"tool_mass", scalar(&Parameters::tool_mass)},
      {"spring_stiffness", scalar(&Parameters::spring_stiffness)},
      {"spring_damping", scalar(&Parameters::spring_damping)},
      {"rest_length", scalar(&Parameters::rest_length)},
      {"link_stiffness", scalar(&Parameters::link_stiffness)},
      {"link_damping", scalar(&Parameters::link_damping)},
      {"trajectory",
       [](const Reader& r, const YAML::Node& n, const std::string& k, Config& c) { c.trajectory = r.knots(n, k); }},
      {"haptic_dt",
       [](const Reader& r, const YAML::Node& n, const std::string& k, Config& c) { c.haptic_dt = r.number(n, k); }},
      {"visual_dts",
       [](const Reader& r, const YAML::Node& n, const std::string& k, Config& c) { c.visual_dts = r.numbers(n, k); }},
      {"latency",
       [](const Reader& r, const YAML::Node& n, const std::string& k, Config& c) { c.latency = r.number(n, k); }},
      {"methods",
       [](const Reader& r, const YAML::Node& n, const std::string& k, Config& c) { c.methods = r.methods(n, k); }},
  };
  return keys;
}

std::string nearestKey(const std::string& key) {
  const auto& keys = knownKeys();
  const auto nearest = std::min_element(keys.begin(), keys.end(), [&](const auto& a, const auto& b) {
    return editDistance(key.substr(0, 60), a.first) < editDistance(key.substr(0, 60), b.first);
  });
  return nearest->first;
}

void readKeys(const Reader& reader, const YAML::Node& root, Config& config) {
  std::set<std::string> seen;
  for (const auto& entry : root) {
    if (!entry.first.IsScalar()) reader.fail("", "keys must be plain names");
    const std::string& key = entry.first.Scalar();
    const auto& keys = knownKeys();
    const auto known = std::find_if(keys.begin(), keys.end(), [&](const auto& k) { return k.first == key; });
    if (known == keys.end()) {
      reader.fail(printable(key), "unknown key; the nearest known key is '" + nearestKey(key) + "'");
    }
    if (!seen.insert(key).second) reader.fail(key, "is given twice");
    known->second(reader, entry.second, key, config);
  }
}

/// Throws unless low <= value <= high.
void checkRange(const std::string& file, const std::string& key, double value, double low, double high) {
  if (value >= low && value <= high) return;  // false for nan as well
  throw InputError(file, key, "must be from " + text(low) + " to " + text(high) + ", not " + text(value));
}

void checkParameters(const Parameters& p, const std::string& file) {
  // The bounds keep every product in the step far from overflow.
  checkRange(file, "handle_mass", p.handle_mass, 1e-9, 1e9);
  checkRange(file, "tool_mass", p.tool_mass, 1e-9, 1e9);
  checkRange(file, "spring_stiffness", p.spring_stiffness, 0.0, 1e12);
  checkRange(file, "spring_damping", p.spring_damping, 0.0, 1e12);
  checkRange(file, "rest_length", p.rest_length, 0.0, 1e6);
  checkRange(file, "link_stiffness", p.link_stiffness, 0.0, 1e12);
  checkRange(file, "link_damping", p.link_damping, 0.0, 1e12);
}

void checkTrajectory(const Config& config, const std::string& file) {
  const std::vector<Knot>& knots = config.trajectory;
  const std::string key = "trajectory";
  if (knots.size() < 2) throw InputError(file, key, "must have at least two points [time in s, position in m]");
  if (knots.front().t != 0.0) throw InputError(file, key, "must start at time 0, not " + text(knots.front().t));
  for (std::size_t i = 0; i < knots.size(); ++i) {
    const std::string here = key + "[" + std::to_string(i) + "]";
    checkRange(file, here, knots[i].t, 0.0, 1e6);
    checkRange(file, here, knots[i].x, -1e6, 1e6);
    if (i > 0 && !(knots[i].t - knots[i - 1].t >= 1e-6)) {
      throw InputError(file, here, "must be at least 1e-6 s later than the point before it");
    }
  }
  if (knots.front().x - config.parameters.rest_length < -1e-12) {
    throw InputError(file, key,
                     "starts with the tool inside the wall: the first position must be at least rest_length, " +
                         text(config.parameters.rest_length) + " m");
  }
}

void checkSteps(const Config& config, const std::string& file) {
  checkRange(file, "haptic_dt", config.haptic_dt, 1e-6, 1.0);
  if (wholeMultiple(Config::kReferenceDt, config.haptic_dt) == 0) {
    throw InputError(file, "haptic_dt",
                     "the reference's visual step of " + text(Config::kReferenceDt) +
                         " s must be a whole multiple of it, unlike of " + text(config.haptic_dt));
  }
  if (config.visual_dts.empty()) throw InputError(file, "visual_dts", "must have at least one step");
  std::set<long long> seen;
  for (std::size_t i = 0; i < config.visual_dts.size(); ++i) {
    const std::string here = "visual_dts[" + std::to_string(i) + "]";
    checkRange(file, here, config.visual_dts[i], config.haptic_dt, 10.0);
    const long long ratio = wholeMultiple(config.visual_dts[i], config.haptic_dt);
    if (ratio == 0) {
      throw InputError(
          file, here,
          "must be a whole multiple of haptic_dt, " + text(config.haptic_dt) + " s, not " + text(config.visual_dts[i]));
    }
    if (!seen.insert(ratio).second) throw InputError(file, here, "is given twice");
  }
  checkRange(file, "latency", config.latency, 0.0, 1000.0);
}

void checkMethods(const Config& config, const std::string& file) {
  if (config.methods.empty()) throw InputError(file, "methods", "must name at least one of vc, hsl");
  const std::set<Method> distinct(config.methods.begin(), config.methods.end());
  if (distinct.size() != config.methods.size()) throw InputError(file, "methods", "names a method twice");
}

void checkSize(const Config& config, const std::string& file) {
  const double ticks = config.trajectory.back().t / config.haptic_dt;
  const double runs = 1.0 + static_cast<double>(config.methods.size() * config.visual_dts.size());
  if (ticks * runs > kMaxRows) {
    throw InputError(file, "trajectory",
                     "is too long: ticks times runs would be " + text(std::round(ticks * runs)) + ", the limit is " +
                         text(kMaxRows));
  }
}

std::string readText(const std::string& file) {
  std::error_code status;
  if (!std::filesystem::exists(file, status)) throw InputError(file, "", "no such file");
  if (std::filesystem::is_directory(file, status)) throw InputError(file, "", "is a folder, not a file");
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw InputError(file, "", "cannot be opened for reading");
  std::string content(kMaxFileBytes + 1, '\0');
  stream.read(content.data(), static_cast<std::streamsize>(content.size()));
  if (stream.bad()) throw InputError(file, "", "cannot be read");
  content.resize(static_cast<std::size_t>(stream.gcount()));
  if (content.size() > kMaxFileBytes) throw InputError(file, "", "is larger than 1 MiB");
  return content;
}

}  // namespace

std::string methodName(Method method) { return method == Method::kVc ? "vc" : "hsl"; }

long long wholeMultiple(double whole, double part) {
  const double ratio = whole / part;
  const double rounded = std::round(ratio);
  const bool is_whole = rounded >= 1.0 && rounded < 1e12 && std::abs(ratio - rounded) <= 1e-9 * rounded;
  return is_whole ? static_cast<long long>(rounded) : 0;
}

Config readConfig(const std::string& file) { return parseConfig(readText(file), file); }

Config parseConfig(const std::string& content, const std::string& name) {
  const Reader reader(name);
  Config config;
  try {
    const std::vector<YAML::Node> documents = YAML::LoadAll(content);
    if (documents.size() > 1) reader.fail("", "has more than one YAML document");
    if (!documents.empty() && !documents[0].IsNull()) {
      if (!documents[0].IsMap()) reader.fail("", "must be a list of 'key: value' lines");
      readKeys(reader, documents[0], config);
    }
  } catch (const YAML::Exception& error) {
    const std::string place = error.mark.is_null() ? "" : "line " + std::to_string(error.mark.line + 1);
    reader.fail(place, "is not valid YAML: " + printable(error.msg));
  }
  validate(config, name);
  return config;
}

void validate(const Config& config, const std::string& name) {
  checkParameters(config.parameters, name);
  checkTrajectory(config, name);
  checkSteps(config, name);
  checkMethods(config, name);
  checkSize(config, name);
}

}  // namespace palpate::one_d
