#include "palpate/scene/schema.h"

#include <map>
#include <nlohmann/json.hpp>
#include <utility>

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kLong = 300;  // characters of a part that is worth a definition

/// Counts what stands under the same key with the same text.
void count(const Json& schema, std::map<std::pair<std::string, std::string>, int>& found) {
  if (!schema.is_structured()) return;
  for (const auto& [key, part] : schema.items()) {
    if (part.is_object()) ++found[{key, part.dump()}];
    count(part, found);
  }
}

class Definitions {
 public:
  explicit Definitions(const Json& schema) { count(schema, found_); }

  /// The outermost first: what is in a definition needs no other.
  void replaceIn(Json& properties) {
    for (auto& [key, part] : properties.items()) {
      const std::string text = part.dump();
      const bool named = key != "properties" && key != "items" && key != "additionalProperties";
      const bool defined = named && part.is_object() && text.size() > kLong && found_[{key, text}] > 1;
      if (defined) {
        const std::string name = nameOf(key, text);
        if (!all.contains(name)) all[name] = part;
        part = {{"$ref", "#/definitions/" + name}};
      } else if (part.is_structured()) {
        replaceIn(part);
      }
    }
  }

  Json all = Json::object();

 private:
  // Of several under one key the later ones are numbered.
  std::string nameOf(const std::string& key, const std::string& text) {
    std::string name = key;
    for (int k = 2; all.contains(name) && all[name].dump() != text; ++k) name = key + "-" + std::to_string(k);
    return name;
  }

  std::map<std::pair<std::string, std::string>, int> found_;
};

}  // namespace

Json finishedSchema(Json schema, const std::string& title) {
  Json out{{"$schema", "http://json-schema.org/draft-07/schema#"}, {"title", title}};
  Definitions definitions(schema);
  definitions.replaceIn(schema);
  for (auto& [key, part] : schema.items()) out[key] = part;
  if (!definitions.all.empty()) out["definitions"] = definitions.all;
  return out;
}

}  // namespace palpate
