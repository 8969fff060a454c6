#include "palpate/scene/value.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

#include "palpate/common/error.h"

namespace palpate {
namespace {

/// Leaves a reading function that describes: what it would object to now depends on what is read.
struct Described {};

constexpr const char* kNamePattern = R"(^(?=.*[^.])[A-Za-z0-9_.-]{1,64}$)";

nlohmann::ordered_json schemaFor(const Range& range) {
  nlohmann::ordered_json out{{"type", "number"}};
  out[range.open_low ? "exclusiveMinimum" : "minimum"] = range.low;
  out[range.open_high ? "exclusiveMaximum" : "maximum"] = range.high;
  if (*range.unit != '\0') out["description"] = range.unit;
  return out;
}

nlohmann::ordered_json schemaForList(const nlohmann::ordered_json& items, std::size_t least, std::size_t most) {
  return {{"type", "array"}, {"minItems", least}, {"maxItems", most}, {"items", items}};
}

/// A number in the range.
double anyOf(const Range& range) {
  if (range.contains(0.0)) return 0.0;
  return range.open_low ? range.high : range.low;
}

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

Value::Value(Schema& schema) : schema_(&schema) {
  static const std::string none;
  file_ = &none;
}

nlohmann::ordered_json Value::schemaOf(const std::function<void(const Value&)>& read) {
  Schema out = Schema::object();
  try {
    read(Value(out));
  } catch (const Described&) {
  }
  return out;
}

template <typename T>
void Value::noteDefault(const T& value) const {
  if (schema_ == nullptr) return;
  if constexpr (std::is_same_v<T, double>) {
    if (!std::isfinite(value)) return;
  }
  if constexpr (std::is_same_v<T, Vec3>) {
    (*schema_)["default"] = {value.x(), value.y(), value.z()};
  } else {
    (*schema_)["default"] = value;
  }
}
template void Value::noteDefault(const double&) const;
template void Value::noteDefault(const int&) const;
template void Value::noteDefault(const bool&) const;
template void Value::noteDefault(const std::string&) const;
template void Value::noteDefault(const Vec3&) const;

void Value::fail(const std::string& cause) const {
  if (describes()) throw Described{};
  failAt(node_->line, cause);
}

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
  if (describes()) {
    *schema_ = schemaFor(range);
    return anyOf(range);
  }
  const double value = anyNumber();
  if (const auto cause = objection(value, range)) fail(*cause);
  return value;
}

int Value::integer(int low, int high) const {
  if (describes()) {
    *schema_ = {{"type", "integer"}, {"minimum", low}, {"maximum", high}};
    return low;
  }
  const double value = number(Range::within(low, high, ""));
  if (value != std::floor(value)) fail(fmt::format("{:g} is not a whole number", value));
  return static_cast<int>(value);
}

std::optional<double> Value::numberOr(const char* word, const Range& range) const {
  if (describes()) {
    *schema_ = {{"anyOf", {{{"const", word}}, schemaFor(range)}}};
    return std::nullopt;
  }
  if (isScalar() && node_->scalar == word) return std::nullopt;
  return number(range);
}

std::optional<int> Value::integerOr(const char* word, int low, int high) const {
  if (describes()) {
    *schema_ = {{"anyOf", {{{"const", word}}, {{"type", "integer"}, {"minimum", low}, {"maximum", high}}}}};
    return std::nullopt;
  }
  if (isScalar() && node_->scalar == word) return std::nullopt;
  if (isScalar() && !node_->scalar.empty() && node_->scalar.find_first_of("0123456789") == std::string::npos)
    fail(fmt::format("{} is neither {} nor a number", shownText(node_->scalar), word));
  return integer(low, high);
}

std::uint64_t Value::seed() const {
  if (describes()) {
    *schema_ = {{"type", "integer"}, {"minimum", 0}, {"maximum", std::numeric_limits<std::uint64_t>::max()}};
    return 0;
  }
  const std::string& text = scalar("a whole number");
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size())
    fail(fmt::format("{} is not a whole number from 0 to {}", shownText(text),
                     std::numeric_limits<std::uint64_t>::max()));
  return value;
}

bool Value::boolean() const {
  if (describes()) {
    *schema_ = {{"type", "boolean"}};
    return false;
  }
  return choice({"false", "true"}) == 1;
}

std::string Value::text(std::size_t max_length) const {
  if (describes()) {  // numbers and words are text too
    *schema_ = {{"type", {"string", "number", "boolean"}}, {"maxLength", max_length}};
    return "text";
  }
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
  if (describes()) {
    *schema_ = {{"type", {"string", "number"}}, {"pattern", kNamePattern}};
    return "name";
  }
  const std::string& text = scalar("a name");
  checkName(text);
  return text;
}

std::size_t Value::choice(const std::vector<std::string>& words) const {
  if (describes()) {
    *schema_ = {{"enum", words}};
    return 0;
  }
  const std::string& text = scalar(("one of " + joined(words)).c_str());
  const auto found = std::find(words.begin(), words.end(), text);
  if (found == words.end()) fail(fmt::format("{} is not one of {}", shownText(text), joined(words)));
  return static_cast<std::size_t>(found - words.begin());
}

Vec3 Value::vector(const Range& range) const {
  const std::vector<Value> parts = exactly(3, "numbers");
  return {parts[0].number(range), parts[1].number(range), parts[2].number(range)};
}

Vec3 Value::direction() const {
  const Vec3 value = vector(Range::within(-1e6, 1e6, ""));
  if (describes()) return Vec3::UnitZ();
  const double length = value.norm();
  if (length < 1e-6) fail("is a zero vector; a direction is needed");
  return value / length;
}

Vec3 Value::rotation(double max_degrees) const {
  return vector(Range::within(-max_degrees, max_degrees, "degrees")) * (std::numbers::pi / 180.0);
}

DocumentNode::Pointer Value::any() const {
  if (describes()) {
    *schema_ = Schema::object();
    return std::make_shared<DocumentNode>();
  }
  return node_;
}

std::vector<Value> Value::exactly(std::size_t count, const char* what, const char* which) const {
  if (describes()) {  // all of one kind
    *schema_ = schemaForList(Schema::object(), count, count);
    return std::vector<Value>(count, Value((*schema_)["items"]));
  }
  std::vector<Value> values = items(count);
  if (values.size() != count) fail(fmt::format("has {} {}; it must have {}{}", values.size(), what, count, which));
  return values;
}

std::vector<Value> Value::items(std::size_t max_count) const {
  if (describes()) {
    *schema_ = schemaForList(Schema::object(), 0, max_count);
    return {Value((*schema_)["items"])};
  }
  if (node_->kind != DocumentNode::Kind::sequence) fail("must be a list");
  if (node_->items.size() > max_count)
    fail(fmt::format("has {} entries; at most {} are allowed", node_->items.size(), max_count));
  std::vector<Value> values;
  for (std::size_t i = 0; i < node_->items.size(); ++i)
    values.push_back(child(fmt::format("[{}]", i), node_->items[i]));
  return values;
}

std::vector<std::pair<std::string, Value>> Value::namedEntries(std::size_t max_count) const {
  if (describes()) {
    *schema_ = {{"type", "object"},
                {"maxProperties", max_count},
                {"propertyNames", {{"pattern", kNamePattern}}},
                {"additionalProperties", Schema::object()}};
    return {{"name", Value((*schema_)["additionalProperties"])}};
  }
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

void Value::describeFields(const std::vector<Field>& fields) const {
  Schema properties = Schema::object(), required = Schema::array();
  for (const Field& field : fields) {
    Schema& property = properties[field.key] = schemaOf(field.read);
    if (!field.required) continue;
    property.erase("default");
    required.push_back(field.key);
  }
  *schema_ = {{"type", "object"}, {"additionalProperties", false}, {"properties", properties}};
  if (!required.empty()) (*schema_)["required"] = required;
}

void Value::fields(const std::vector<Field>& fields) const {
  if (describes()) return describeFields(fields);
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
  if (describes()) {
    std::reverse(all.begin(), all.end());  // so that the first choice is what stays read
    describeFields(all);
    Schema& one = (*schema_)["oneOf"] = Schema::array();
    for (const std::string& name : names) one.push_back({{"required", {name}}});
    return;
  }
  rejectUnknownKeys(known);
  const auto present =
      std::count_if(names.begin(), names.end(), [&](const std::string& key) { return find(key) != nullptr; });
  if (present != 1) fail(fmt::format("has {} of the keys {}; it must have exactly one", present, joined(names)));
  fields(all);
}

}  // namespace palpate
