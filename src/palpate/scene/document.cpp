#include "palpate/scene/document.h"

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/mark.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <fstream>
#include <sstream>
#include <unordered_map>

#include "palpate/common/error.h"
#include "palpate/scene/text.h"

namespace palpate {
namespace {

using Kind = DocumentNode::Kind;

std::string lineKey(int line) { return line > 0 ? "line " + std::to_string(line) : ""; }

/// Builds the tree from the parser's events. The parser recurses once a level and reports each level before it goes
/// down, so that throwing here at the depth limit bounds its stack too.
class TreeBuilder : public YAML::EventHandler {
 public:
  TreeBuilder(const std::string& file, const DocumentLimits& limits) : file_(file), limits_(limits) {}

  DocumentNode::Pointer root() const { return root_; }

  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}

  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { place(make(Kind::null, mark), anchor); }

  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    count(mark);
    const auto found = anchors_.find(anchor);
    if (found == anchors_.end()) fail(lineOf(mark), "an alias inside the value that it names");
    place(found->second, YAML::NullAnchor);
  }

  void OnScalar(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor, const std::string& text) override {
    auto node = make(Kind::scalar, mark);
    node->scalar = text;
    place(node, anchor);
  }

  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value) override {
    open(make(Kind::sequence, mark), anchor);
  }
  void OnSequenceEnd() override { close(); }

  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value) override {
    open(make(Kind::map, mark), anchor);
  }
  void OnMapEnd() override { close(); }

 private:
  struct Level {
    std::shared_ptr<DocumentNode> node;
    YAML::anchor_t anchor;
    bool has_key = false;
    std::string key;
    int key_line = 0;
  };

  static int lineOf(const YAML::Mark& mark) { return mark.is_null() ? 0 : mark.line + 1; }

  [[noreturn]] void fail(int line, const std::string& cause) const { throw InputError(file_, lineKey(line), cause); }

  void count(const YAML::Mark& mark) {
    if (++nodes_ > limits_.nodes) fail(lineOf(mark), "more than " + std::to_string(limits_.nodes) + " values");
  }

  std::shared_ptr<DocumentNode> make(Kind kind, const YAML::Mark& mark) {
    count(mark);
    auto node = std::make_shared<DocumentNode>();
    node->kind = kind;
    node->line = lineOf(mark);
    return node;
  }

  void open(std::shared_ptr<DocumentNode> node, YAML::anchor_t anchor) {
    if (static_cast<int>(levels_.size()) >= limits_.depth)
      fail(node->line, "nested more than " + std::to_string(limits_.depth) + " deep");
    levels_.push_back({std::move(node), anchor, false, {}, 0});
  }

  void close() {
    const Level level = std::move(levels_.back());
    levels_.pop_back();
    place(level.node, level.anchor);
  }

  void place(const DocumentNode::Pointer& node, YAML::anchor_t anchor) {
    if (anchor != YAML::NullAnchor) anchors_[anchor] = node;
    if (levels_.empty()) {
      root_ = node;
    } else if (Level& level = levels_.back(); level.node->kind == Kind::sequence) {
      level.node->items.push_back(node);
    } else if (!level.has_key) {
      takeKey(level, *node);
    } else {
      level.node->entries.push_back({std::move(level.key), level.key_line, node});
      level.has_key = false;
    }
  }

  void takeKey(Level& level, const DocumentNode& key) const {
    if (key.kind != Kind::scalar) fail(key.line, "a key must be plain text");
    // Checked against a limit of keys rather than with an index: no part of a scene has many keys.
    constexpr std::size_t max_keys = 1000;
    const auto& entries = level.node->entries;
    if (entries.size() >= max_keys) fail(key.line, "more than " + std::to_string(max_keys) + " keys in one map");
    const auto same = [&](const auto& entry) { return entry.key == key.scalar; };
    if (std::any_of(entries.begin(), entries.end(), same))
      fail(key.line, "the key '" + printable(key.scalar) + "' is given twice");
    level.key = key.scalar;
    level.key_line = key.line;
    level.has_key = true;
  }

  const std::string& file_;
  const DocumentLimits& limits_;
  std::size_t nodes_ = 0;
  std::vector<Level> levels_;
  std::unordered_map<YAML::anchor_t, DocumentNode::Pointer> anchors_;
  DocumentNode::Pointer root_;
};

}  // namespace

DocumentNode::Pointer parseDocument(std::string_view text, const std::string& file, const DocumentLimits& limits) {
  if (text.size() > limits.bytes) throw InputError(file, "", "larger than " + std::to_string(limits.bytes) + " bytes");
  std::istringstream stream{std::string(text)};
  TreeBuilder builder(file, limits);
  try {
    YAML::Parser parser(stream);
    if (!parser.HandleNextDocument(builder) || !builder.root()) throw InputError(file, "", "is empty");
    TreeBuilder rest(file, limits);
    if (parser.HandleNextDocument(rest)) throw InputError(file, "", "holds more than one YAML document");
  } catch (const YAML::Exception& error) {
    throw InputError(file, lineKey(error.mark.is_null() ? 0 : error.mark.line + 1),
                     "is not valid YAML: " + printable(error.msg, 200));
  }
  return builder.root();
}

std::string readDocumentText(const std::filesystem::path& file) {
  const std::string name = file.string();
  std::error_code error;
  const auto status = std::filesystem::status(file, error);
  if (!std::filesystem::exists(status)) throw InputError(name, "", "no such file");
  if (!std::filesystem::is_regular_file(status)) throw InputError(name, "", "is not a regular file");
  const DocumentLimits limits;
  std::ifstream stream(file, std::ios::binary);
  std::string text(limits.bytes + 1, '\0');  // one more byte than allowed, so that the parser notices a longer file
  stream.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (!stream && !stream.eof()) throw InputError(name, "", "cannot be read");
  text.resize(static_cast<std::size_t>(stream.gcount()));
  return text;
}

}  // namespace palpate
