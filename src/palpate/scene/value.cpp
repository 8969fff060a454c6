#include "palpate/scene/value.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

#include "palpate/common/error.h"

namespace palpate {
namespace {

std::string joined(const std::vector<std::string>& words) {
  std::string list;
  for (const std::string& word : words) list += (list.empty() ? "" : ", ") + word;
  return list;
}

/// YAML's spellings of what is no finite number.
std::optional<double> specialNumber(std::string_view text) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  if (text == ".nan" || text == ".NaN" || text == ".NAN") return std::numeric_limits<double>::quiet_NaN();
  const bool negative = text.starts_with('-');
  if (negative) text.remove_prefix(1);
  if (text == ".inf" || text == ".Inf" || text == ".INF") return negative ? -infinity : infinity;
  return std::nullopt;
}

}  // namespace

bool Range::contains(double value) const {
  return (open_low ? value > low : value >= low) && (open_high ? value < high : value <= high);
}

std::string Range::text() const {
  const std::string suffix = *unit == '\0' ? "" : fmt::format(" {}", unit);
  return fmt::format("{} {:g} and {} {:g}{}", open_low ? "above" : "at least", low, open_high ? "below" : "at most",
                     high, suffix);
}

std::optional<std::string> objection(double value, const Range& range) {
  if (!std::isfinite(value)) return fmt::format("{:g} is not a finite number; it must be {}", value, range.text());
  if (!range.contains(value)) return fmt::format("{:g} is out of range; it must be {}", value, range.text());
  return std::nullopt;
}

void Value::fail(const std::string& cause) const { failAt(node_->line, cause); }

void Value::failAt(int line_number, const std::string& cause) const {
  const std::string line = line_number > 0 ? fmt::format("line {}", line_number) : "";
  if (key_.empty()) throw InputError(*file_, line, cause);
  throw InputError(*file_, line.empty() ? key_ : fmt::format("{} ({})", key_, line), cause);
}

Value Value::child(const std::string& key, DocumentNode::Pointer node) const {
  return {*file_, key_.empty() || key.front() == '[' ? key_ + key : key_ + "." + key, std::move(node)};
}

const std::string& Value::scalar(const char* expected) const {
  if (isNull()) fail(fmt::format("has no value; it must be {}", expected));
  if (!isScalar()) fail(fmt::format("is a {}; it must be {}", isMap() ? "map" : "list", expected));
  return node_->scalar;
}

double Value::anyNumber() const {
  const std::string& text = scalar("a number");
  std::string_view digits = text;
  if (digits.starts_with('+') && !digits.starts_with("+-")) digits.remove_prefix(1);
  if (const auto special = specialNumber(digits)) return *special;
  double value = 0.0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error == std::errc::result_out_of_range)
    fail(fmt::format("{} is too large or too small for a number", shownText(text)));
  if (error != std::errc() || end != digits.data() + digits.size())
    fail(fmt::format("{} is not a number", shownText(text)));
  return value;
}

double Value::number(const Range& range) const {
  const double value = anyNumber();
  if (const auto cause = objection(value, range)) fail(*cause);
  return value;
}

int Value::integer(int low, int high) const {
  const double value = number(Range::within(low, high, ""));
  if (value != std::floor(value)) fail(fmt::format("{:g} is not a whole number", value));
  return static_cast<int>(value);
}

std::uint64_t Value::seed() const {
  const std::string& text = scalar("a whole number");
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size())
    fail(fmt::format("{} is not a whole number from 0 to {}", shownText(text),
                     std::numeric_limits<std::uint64_t>::max()));
  return value;
}

bool Value::boolean() const { return choice({"false", "true"}) == 1; }

std::string Value::text(std::size_t max_length) const {
  const std::string& text = scalar("text");
  if (text.size() > max_length) fail(fmt::format("is longer than {} characters", max_length));
  if (text.find('\0') != std::string::npos) fail("holds a zero byte");
  return text;
}

void Value::checkName(const std::string& text) const {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' ||
           c == '.';
  };
  // files and folders are named after it
  const bool folder = text.find_first_not_of('.') == std::string::npos;
  if (text.size() > 64 || folder || !std::all_of(text.begin(), text.end(), allowed))
    fail(fmt::format("{} is not a name; use at most 64 letters, digits, '-', '_' and '.'", shownText(text)));
}

std::string Value::name() const {
  const std::string& text = scalar("a name");
  checkName(text);
  return text;
}

std::size_t Value::choice(const std::vector<std::string>& words) const {
  const std::string& text = scalar(("one of " + joined(words)).c_str());
  const auto found = std::find(words.begin(), words.end(), text);
  if (found == words.end()) fail(fmt::format("{} is not one of {}", shownText(text), joined(words)));
  return static_cast<std::size_t>(found - words.begin());
}

Vec3 Value::vector(const Range& range) const {
  const std::vector<Value> parts = items(3);
  if (parts.size() != 3) fail(fmt::format("has {} numbers; it must have 3", parts.size()));
  return {parts[0].number(range), parts[1].number(range), parts[2].number(range)};
}

Vec3 Value::direction() const {
  const Vec3 value = vector(Range::within(-1e6, 1e6, ""));
  const double length = value.norm();
  if (length < 1e-6) fail("is a zero vector; a direction is needed");
  return value / length;
}

Vec3 Value::rotation(double max_degrees) const {
  return vector(Range::within(-max_degrees, max_degrees, "degrees")) * (std::numbers::pi / 180.0);
}

std::vector<Value> Value::items(std::size_t max_count) const {
  if (node_->kind != DocumentNode::Kind::sequence) fail("must be a list");
  if (node_->items.size() > max_count)
    fail(fmt::format("has {} entries; at most {} are allowed", node_->items.size(), max_count));
  std::vector<Value> values;
  for (std::size_t i = 0; i < node_->items.size(); ++i)
    values.push_back(child(fmt::format("[{}]", i), node_->items[i]));
  return values;
}

std::vector<std::pair<std::string, Value>> Value::namedEntries(std::size_t max_count) const {
  if (!isMap()) fail("must be a map of names");
  if (entryCount() > max_count) fail(fmt::format("has {} entries; at most {} are allowed", entryCount(), max_count));
  std::vector<std::pair<std::string, Value>> values;
  for (const auto& [key, line, node] : node_->entries) {
    checkName(key);
    values.emplace_back(key, child(key, node));
  }
  return values;
}

const DocumentNode::Pointer* Value::find(const std::string& key) const {
  for (const auto& entry : node_->entries)
    if (entry.key == key) return &entry.value;
  return nullptr;
}

void Value::rejectUnknownKeys(const std::vector<std::string>& known) const {
  if (!isMap()) fail(fmt::format("must be a map with keys such as {}", known.front()));
  for (const DocumentNode::Entry& entry : node_->entries) {
    if (std::find(known.begin(), known.end(), entry.key) != known.end()) continue;
    failAt(entry.line, fmt::format("unknown key {}; the nearest known key is \"{}\"", shownText(entry.key),
                                   nearestWord(entry.key, known)));
  }
}

void Value::fields(const std::vector<Field>& fields) const {
  std::vector<std::string> known;
  for (const Field& field : fields) known.push_back(field.key);
  rejectUnknownKeys(known);
  for (const Field& field : fields) {
    if (const DocumentNode::Pointer* node = find(field.key)) {
      field.read(child(field.key, *node));
    } else if (field.required) {
      fail(fmt::format("the key \"{}\" is missing", field.key));
    }
  }
}

void Value::oneOf(const std::vector<Field>& choices, const std::vector<Field>& others) const {
  std::vector<Field> all = choices;
  all.insert(all.end(), others.begin(), others.end());
  std::vector<std::string> known, names;
  for (const Field& field : all) known.push_back(field.key);
  for (const Field& field : choices) names.push_back(field.key);
  rejectUnknownKeys(known);
  const auto present =
      std::count_if(names.begin(), names.end(), [&](const std::string& key) { return find(key) != nullptr; });
  if (present != 1) fail(fmt::format("has {} of the keys {}; it must have exactly one", present, joined(names)));
  fields(all);
}

}  // namespace palpate
