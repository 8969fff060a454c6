#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

/// A parsed YAML value with its place: null, a scalar as text, a sequence or a map. Immutable; aliases share it.
struct DocumentNode {
  enum class Kind { null, scalar, sequence, map };
  using Pointer = std::shared_ptr<const DocumentNode>;

  struct Entry {
    std::string key;
    int line = 0;  ///< of the key
    Pointer value;
  };

  Kind kind = Kind::null;
  int line = 0;  ///< from 1
  std::string scalar;
  std::vector<Pointer> items;  ///< of a sequence
  std::vector<Entry> entries;  ///< of a map, in the file's order; keys are unique
};

/// Bounds on a document; beyond them it is rejected before it costs anything.
struct DocumentLimits {
  std::size_t bytes = 1 << 20;
  std::size_t nodes = 200000;
  int depth = 32;
};

/// Text of a file that parseDocument() is to read: at most one byte more than it allows, so that it notices a longer
/// one.
/// @throws InputError if there is no such regular file or it cannot be read
std::string readDocumentText(const std::filesystem::path& file);

/// Parses one YAML document. Keys must be plain text and unique. Anchors and aliases are followed, merge keys (<<) are
/// not.
/// @param file  named in errors
/// @throws InputError (file, "line N", cause) if the text is no such document or goes beyond the limits
DocumentNode::Pointer parseDocument(std::string_view text, const std::string& file, const DocumentLimits& limits = {});

}  // namespace palpate
