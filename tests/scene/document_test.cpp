#include <fmt/format.h>

#include <chrono>

#include "palpate/scene/document.h"
#include "scene_text.h"

namespace palpate {
namespace {

std::string rejectedDocument(const std::string& text, const DocumentLimits& limits = {}) {
  return rejection([&] { parseDocument(text, "d.yaml", limits); });
}

std::string repeated(const std::string& part, std::size_t bytes) {
  std::string text;
  while (text.size() + part.size() <= bytes) text += part;
  return text;
}

TEST(Document, KeepsKindsOrderAndLines) {
  const auto root = parseDocument("b: 1\na:\n  - x\n  - ~\n", "d.yaml");
  ASSERT_EQ(root->kind, DocumentNode::Kind::map);
  ASSERT_EQ(root->entries.size(), 2U);
  EXPECT_EQ(root->entries[0].key, "b");
  EXPECT_EQ(root->entries[0].value->scalar, "1");
  const DocumentNode& list = *root->entries[1].value;
  ASSERT_EQ(list.items.size(), 2U);
  EXPECT_EQ(list.items[0]->line, 3);
  EXPECT_EQ(list.items[1]->kind, DocumentNode::Kind::null);
}

TEST(Document, AliasesShareTheirValue) {
  const auto root = parseDocument("a: &v [1, 2]\nb: *v\n", "d.yaml");
  EXPECT_EQ(root->entries[0].value, root->entries[1].value);
}

TEST(Document, RejectsWhatIsNoDocument) {
  EXPECT_EQ(rejectedDocument(""), "d.yaml: is empty");
  EXPECT_EQ(rejectedDocument("# only a comment\n"), "d.yaml: is empty");
  EXPECT_EQ(rejectedDocument("a: 1\n---\nb: 2\n"), "d.yaml: holds more than one YAML document");
  EXPECT_EQ(rejectedDocument("a: 1\nb: [1, 2\n").substr(0, 33), "d.yaml: line 3: is not valid YAML");
  EXPECT_EQ(rejectedDocument("a: 1\na: 2\n"), "d.yaml: line 2: the key 'a' is given twice");
  EXPECT_EQ(rejectedDocument("[a, b]: 1\n"), "d.yaml: line 1: a key must be plain text");
  EXPECT_EQ(rejectedDocument("a: *missing\n").substr(0, 33), "d.yaml: line 1: is not valid YAML");
  EXPECT_EQ(rejectedDocument("a: &v [1, *v]\n"), "d.yaml: line 1: an alias inside the value that it names");
}

TEST(Document, ErrorsShowNoControlCharacters) {
  EXPECT_EQ(rejectedDocument("a: \"\\\x01\"\n"), "d.yaml: line 1: is not valid YAML: unknown escape character: ?");
}

TEST(Document, HoldsItsLimits) {
  DocumentLimits limits;
  limits.bytes = 20;
  EXPECT_NE(parseDocument(std::string(17, 'a') + ": 1", "d.yaml", limits), nullptr);
  EXPECT_EQ(rejectedDocument(std::string(18, 'a') + ": 1", limits), "d.yaml: larger than 20 bytes");
  limits = {};
  limits.nodes = 4;
  EXPECT_NE(parseDocument("[1, 2, 3]", "d.yaml", limits), nullptr);
  EXPECT_EQ(rejectedDocument("[1, 2, 3, 4]", limits), "d.yaml: line 1: more than 4 values");
  limits = {};
  limits.depth = 3;
  EXPECT_NE(parseDocument("[[[]]]", "d.yaml", limits), nullptr);
  EXPECT_EQ(rejectedDocument("[[[[]]]]", limits), "d.yaml: line 1: nested more than 3 deep");
  std::string keys;
  for (int i = 0; i <= 1000; ++i) keys += fmt::format("k{}: 1\n", i);
  EXPECT_EQ(rejectedDocument(keys), "d.yaml: line 1001: more than 1000 keys in one map");
}

// Texts that are cheap to write and have cost parsers their stack, their memory or hours.
TEST(Document, HostileTextsEndSoon) {
  const std::size_t bytes = DocumentLimits{}.bytes;
  for (const char* part : {"[",       "{",  "- ", "? ",  "a: ",          "{a: ", "[a, ",  "- - ? ", "&a ",   "! ",
                           "!!a ",    "\"", "'",  "|\n", "a\n",          "\n ",  "%A\n",  "---\n",  "...\n", "*a ",
                           "a: &a\n", ", ", "]",  "\t",  "\xef\xbb\xbf", "\xff", "[a]: ", "{,",     ": ",    "\\"}) {
    const auto start = std::chrono::steady_clock::now();
    try {
      parseDocument(repeated(part, bytes), "d.yaml");
    } catch (const InputError&) {  // most of them are; what counts is that nothing else happens
    }
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
    EXPECT_LT(elapsed.count(), 20.0) << part;
  }
}

TEST(Document, AliasBombStaysSmall) {
  std::string text = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n";
  for (int i = 1; i < 30; ++i) {
    const std::string below = fmt::format("*a{}", i - 1);
    text += fmt::format("a{0}: &a{0} [{1}, {1}, {1}, {1}, {1}, {1}, {1}, {1}, {1}, {1}]\n", i, below);
  }
  EXPECT_EQ(parseDocument(text, "d.yaml")->entries.size(), 30U);
}

}  // namespace
}  // namespace palpate
