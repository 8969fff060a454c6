#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace palpate {

/// A schema that Value::schemaOf() made, as a document of its own (JSON Schema, draft 7, which editors know): with a
/// title, and with what stands in it several times, such as a region, once under `definitions`.
nlohmann::ordered_json finishedSchema(nlohmann::ordered_json schema, const std::string& title);

}  // namespace palpate
