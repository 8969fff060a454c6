#include "palpate/cases/study_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "palpate/common/error.h"
#include "palpate/scene/checks.h"
#include "palpate/scene/limits.h"
#include "palpate/scene/schema.h"
#include "palpate/scene/value.h"
#include "palpate/study/stress_output.h"

namespace palpate {
namespace {

constexpr int kStudyVersion = 1;
constexpr std::size_t kMostScenes = 1000;
constexpr std::size_t kMostValues = 10000;  // of one list
constexpr std::size_t kMostKeys = 100;
constexpr int kMostSeeds = 100000;

const std::vector<std::string> kMaterialKeys{"youngs_modulus", "poisson_ratio", "density", "damping_alpha",
                                             "damping_beta"};

void readVersion(const Value& value) {
  if (value.describes()) return static_cast<void>(value.integer(kStudyVersion, kStudyVersion));
  const int version = value.integer(0, 1000000);
  if (version != kStudyVersion)
    value.fail(fmt::format("study version {} is not known; this program reads version {}", version, kStudyVersion));
}

/// Items of a list that is not empty, each once.
template <typename T, typename Read>
std::vector<T> readList(const Value& list, std::size_t most, const Read& read) {
  std::vector<T> out;
  for (const Value& item : list.items(most)) {
    out.push_back(read(item));
    if (std::count(out.begin(), out.end(), out.back()) > 1) item.fail("is given twice");
  }
  if (out.empty()) list.fail("is empty; leave the key out, or give at least one");
  return out;
}

HandStiffness readHand(const Value& value) {
  const std::string text = value.text(100);
  const auto hand = parseHand(text);
  if (!hand) value.fail(fmt::format("\"{}\" is no hand: STIFFNESS/DAMPING in N/m and N s/m, or none", text));
  return *hand;
}

void readHands(const Value& list, std::vector<HandStiffness>& hands) {
  std::set<std::string> seen;
  for (const Value& item : list.items(100)) {
    hands.push_back(readHand(item));
    if (!seen.insert(toString(hands.back())).second) item.fail("is given twice");
  }
  if (hands.empty()) list.fail("is empty; leave the key out, or give at least one");
}

/// Seeds that count up.
void readSeeds(const Value& value, std::vector<std::uint64_t>& seeds) {
  std::uint64_t first = 1;
  int count = 0;
  value.fields({{"first", [&](const Value& v) { first = v.seed(); }},
                required({"count", [&](const Value& v) { count = v.integer(1, kMostSeeds); }})});
  if (first > std::numeric_limits<std::uint64_t>::max() - kMostSeeds) value.fail("counts beyond the largest seed");
  for (int k = 0; k < count; ++k) seeds.push_back(first + static_cast<std::uint64_t>(k));
}

MaterialVariant readMaterial(const Value& value) {
  MaterialVariant material;
  material.of = "tool";
  std::vector<Field> fields{required({"name", [&](const Value& v) { material.name = v.name(); }}),
                            {"of", [&](const Value& v) { material.of = v.name(); }}};
  for (const std::string& key : kMaterialKeys) {
    fields.push_back({key, [&material, key](const Value& v) {
                        material.values.emplace_back(key, v.any());
                        v.number(Range{});  // the scene's reader knows the range
                      }});
  }
  value.fields(fields);
  if (material.values.empty()) value.fail("gives no key of a material");
  return material;
}

void readMaterials(const Value& list, std::vector<MaterialVariant>& materials) {
  std::set<std::string> names;
  for (const Value& item : list.items(kMostValues)) {
    materials.push_back(readMaterial(item));
    if (!names.insert(materials.back().name).second) item.fail("has the name of another");
  }
  if (materials.empty()) list.fail("is empty; leave the key out, or give at least one");
}

/// Whether a value holds at most so many others, aliases written out: they are copied into each case.
bool isSmall(const DocumentNode& node, int& left) {
  if (--left < 0) return false;
  for (const auto& item : node.items)
    if (!isSmall(*item, left)) return false;
  for (const auto& entry : node.entries)
    if (!isSmall(*entry.value, left)) return false;
  return true;
}

DocumentNode::Pointer readValue(const Value& value) {
  int left = 1000;
  DocumentNode::Pointer node = value.any();
  if (!isSmall(*node, left)) value.fail("holds more than 1000 values");
  return node;
}

std::vector<KeyVariants> readKeys(const Value& map, bool lists) {
  std::vector<KeyVariants> out;
  for (const auto& [key, value] : map.namedEntries(kMostKeys)) {
    KeyVariants& variants = out.emplace_back();
    variants.key = key;
    if (!lists) {
      variants.values.push_back(readValue(value));
      continue;
    }
    for (const Value& item : value.items(kMostValues)) variants.values.push_back(readValue(item));
    if (variants.values.empty()) value.fail("is empty; at least one value is needed");
  }
  return out;
}

void readRun(const Value& value, CaseSettings& settings) {
  value.fields(
      {{"tables", [&](const Value& v) { settings.tables = static_cast<RunTables>(v.choice(runTablesNames())); }}});
}

void readEvaluate(const Value& value, CaseSettings& settings) {
  value.fields({booleanField("reference_check", settings.reference_check), booleanField("pages", settings.pages)});
}

void readStress(const Value& value, CaseSettings& settings) {
  static const std::vector<std::string> hands{"wild", "ride"};
  StressMotion& motion = settings.motion;
  value.fields({{"hand", [&](const Value& v) { settings.riding = v.choice(hands) == 1; }},
                {"steps", [&](const Value& v) { settings.steps = v.integer(1, 10000000); }},
                {"rides", [&](const Value& v) { settings.rides = v.integer(1, 1000000); }},
                numberField("speed", motion.speed, Range::within(0.01, 50.0, "m/s")),
                numberField("spin", motion.spin, Range::within(0.1, 500.0, "rad/s")),
                numberField("ride", motion.ride, Range::within(0.1, 3600.0, "s")),
                booleanField("static", settings.solve_static)});
  if (!settings.riding && settings.rides > 0) value.fail("rides needs hand: ride");
  if (!settings.riding && settings.solve_static) value.fail("static needs hand: ride");
  if (settings.steps > 0 && settings.rides > 0) value.fail("has steps and rides; give one of them");
}

void readKind(const Value& value, StudyConfig& study) {
  study.kind = static_cast<CaseKind>(value.choice(caseKindNames()));
}

/// Settings of a kind, which another has no use for.
Field settingsField(StudyConfig& study, CaseKind kind, void (*read)(const Value&, CaseSettings&)) {
  return {caseKindNames()[static_cast<std::size_t>(kind)], [&study, kind, read](const Value& value) {
            if (kind != study.kind && !value.describes())
              value.fail(fmt::format("is for studies of that kind, and this one is of kind {}",
                                     caseKindNames()[static_cast<std::size_t>(study.kind)]));
            read(value, study.settings);
          }};
}

void readRoot(const Value& root, StudyConfig& study) {
  const auto word = [](const Value& v) { return methodNames()[v.choice(methodNames())]; };
  const auto file = [](const Value& v) { return v.text(4000); };
  root.fields(
      {required({"palpate_study", readVersion}),
       required({"name", [&](const Value& v) { study.name = v.name(); }}),
       {"description", [&](const Value& v) { study.description = v.text(10000); }},
       required({"kind", [&](const Value& v) { readKind(v, study); }}),
       required({"scenes", [&](const Value& v) { study.scenes = readList<std::string>(v, kMostScenes, file); }}),
       {"set", [&](const Value& v) { study.set = readKeys(v, false); }},
       {"materials", [&](const Value& v) { readMaterials(v, study.materials); }},
       {"vary", [&](const Value& v) { study.vary = readKeys(v, true); }},
       {"methods", [&](const Value& v) { study.methods = readList<std::string>(v, methodNames().size(), word); }},
       {"visual_steps",
        [&](const Value& v) {
          study.visual_steps =
              readList<double>(v, 100, [](const Value& item) { return item.number(limits::kVisualStep); });
        }},
       {"hands",
        [&](const Value& v) {
          readHands(v, study.hands);
          if (study.kind == CaseKind::stress) v.fail("a stress has a hand of its own: stress.hand");
        }},
       {"seeds", [&](const Value& v) { readSeeds(v, study.seeds); }},
       settingsField(study, CaseKind::run, readRun),
       settingsField(study, CaseKind::evaluate, readEvaluate),
       settingsField(study, CaseKind::stress, readStress)});
}

}  // namespace

const std::vector<std::string>& caseKindNames() {
  static const std::vector<std::string> names{"run", "evaluate", "stress"};
  return names;
}

StudyConfig readStudyFromString(std::string_view text, const std::string& name) {
  StudyConfig study;
  study.file = name;
  readRoot(Value(name, "", parseDocument(text, name)), study);
  return study;
}

StudyConfig readStudy(const std::filesystem::path& file) {
  return readStudyFromString(readDocumentText(file), file.string());
}

nlohmann::ordered_json studySchema() {
  nlohmann::ordered_json schema = Value::schemaOf([](const Value& root) {
    StudyConfig study;
    readRoot(root, study);
  });
  return finishedSchema(std::move(schema), "Parameter study of Palpate, version 1");
}

}  // namespace palpate
