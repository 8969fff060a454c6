#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/math/types.h"
#include "palpate/scene/document.h"
#include "palpate/scene/text.h"

namespace palpate {

/// Numbers that a setting may have, with their unit; says itself in errors.
struct Range {
  double low = -std::numeric_limits<double>::max();
  double high = std::numeric_limits<double>::max();
  const char* unit = "";
  bool open_low = false;   ///< low itself is excluded
  bool open_high = false;  ///< high itself is excluded

  bool contains(double value) const;
  /// E.g. "above 0 and at most 100 kg".
  std::string text() const;

  static Range within(double low, double high, const char* unit) { return {low, high, unit, false, false}; }
  static Range positive(double high, const char* unit) { return {0.0, high, unit, true, false}; }
  static Range between(double low, double high, const char* unit) { return {low, high, unit, true, true}; }
};

/// Cause for a number that is not finite or not in the range; none if all is well.
std::optional<std::string> objection(double value, const Range& range);

class Value;

/// One key that a map may have.
struct Field {
  std::string key;
  std::function<void(const Value&)> read;
  bool required = false;
};

/// A value of a scene file together with its place, so that whatever is wrong with it can be said in one line. Every
/// reading function throws InputError (file, "key.path (line N)", cause).
///
/// The functions that read a file describe it too, so that its JSON Schema cannot differ from what is read: a value
/// that describes has no node, and each reading function notes in a schema what it takes and returns something of that
/// kind.
class Value {
 public:
  Value(const std::string& file, std::string key, DocumentNode::Pointer node)
      : file_(&file), key_(std::move(key)), node_(std::move(node)) {}

  /// The JSON Schema of what `read` reads.
  static nlohmann::ordered_json schemaOf(const std::function<void(const Value&)>& read);
  /// Whether it describes: what a key means for another is not to be looked at then.
  bool describes() const { return schema_ != nullptr; }
  /// Notes what the value is where the file has none.
  template <typename T>
  void noteDefault(const T& value) const;

  [[noreturn]] void fail(const std::string& cause) const;

  bool isMap() const { return is(DocumentNode::Kind::map); }
  bool isScalar() const { return is(DocumentNode::Kind::scalar); }
  bool isNull() const { return is(DocumentNode::Kind::null); }
  std::size_t entryCount() const { return node_ ? node_->entries.size() : 0; }

  double number(const Range& range) const;
  int integer(int low, int high) const;
  /// None where the word stands in its place.
  std::optional<double> numberOr(const char* word, const Range& range) const;
  std::optional<int> integerOr(const char* word, int low, int high) const;
  std::uint64_t seed() const;
  bool boolean() const;
  std::string text(std::size_t max_length) const;
  /// Letters, digits, '-', '_' and '.', at most 64 of them.
  std::string name() const;
  /// Index of the word in `words`.
  std::size_t choice(const std::vector<std::string>& words) const;
  /// Sequence of three numbers.
  Vec3 vector(const Range& range) const;
  /// Non-zero vector, made one long.
  Vec3 direction() const;
  /// Rotation vector in degrees, returned in rad.
  Vec3 rotation(double max_degrees) const;

  /// Whatever it is.
  DocumentNode::Pointer any() const;

  /// Items of a sequence of at most max_count.
  std::vector<Value> items(std::size_t max_count) const;
  /// Items of a sequence of `count`, such as "numbers"; more of them are said by `which`.
  std::vector<Value> exactly(std::size_t count, const char* what, const char* which = "") const;
  /// Keys, which must be names, and values of a map of at most max_count.
  std::vector<std::pair<std::string, Value>> namedEntries(std::size_t max_count) const;
  /// Reads a map: every key by its field, in the order of `fields`. Keys without a field and required fields without a
  /// key are errors.
  void fields(const std::vector<Field>& fields) const;
  /// Reads a map with exactly one of the fields' keys, and any of `others`.
  void oneOf(const std::vector<Field>& choices, const std::vector<Field>& others = {}) const;

 private:
  using Schema = nlohmann::ordered_json;
  explicit Value(Schema& schema);
  bool is(DocumentNode::Kind kind) const { return node_ && node_->kind == kind; }
  void describeFields(const std::vector<Field>& fields) const;
  Value child(const std::string& key, DocumentNode::Pointer node) const;
  [[noreturn]] void failAt(int line_number, const std::string& cause) const;
  double anyNumber() const;
  void checkName(const std::string& text) const;
  const std::string& scalar(const char* expected) const;
  void rejectUnknownKeys(const std::vector<std::string>& known) const;
  const DocumentNode::Pointer* find(const std::string& key) const;

  const std::string* file_;
  std::string key_;
  DocumentNode::Pointer node_;
  Schema* schema_ = nullptr;  // of a value that describes
};

// Fields that put a checked value into a variable, which holds what it is by default.

inline Field required(Field field) {
  field.required = true;
  return field;
}
template <typename T, typename Read>
Field fieldInto(const char* key, T& target, Read read) {
  return {key, [&target, read](const Value& value) {
            const T before = target;
            target = read(value);
            value.noteDefault(before);
          }};
}
inline Field numberField(const char* key, double& target, const Range& range) {
  return fieldInto(key, target, [range](const Value& value) { return value.number(range); });
}
inline Field numberField(const char* key, std::optional<double>& target, const Range& range) {
  return {key, [&target, range](const Value& value) { target = value.number(range); }};
}
inline Field integerField(const char* key, int& target, int low, int high) {
  return fieldInto(key, target, [low, high](const Value& value) { return value.integer(low, high); });
}
inline Field booleanField(const char* key, bool& target) {
  return fieldInto(key, target, [](const Value& value) { return value.boolean(); });
}
inline Field vectorField(const char* key, Vec3& target, const Range& range) {
  return fieldInto(key, target, [range](const Value& value) { return value.vector(range); });
}
inline Field directionField(const char* key, Vec3& target) {
  return {key, [&target](const Value& value) { target = value.direction(); }};
}

}  // namespace palpate
