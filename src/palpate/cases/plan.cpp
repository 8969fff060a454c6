#include "palpate/cases/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <map>
#include <set>

#include "palpate/cases/engines.h"
#include "palpate/cases/files.h"
#include "palpate/common/error.h"
#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"
#include "palpate/scene/checks.h"
#include "palpate/scene/reader.h"
#include "palpate/scene/save.h"
#include "palpate/scene/text.h"
#include "palpate/study/evaluate.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int kMostCases = 100000;

/// One value of an axis: how it is called, and what it puts into the scene.
struct Choice {
  Json name;
  std::vector<SceneEdit> edits;
};
struct Axis {
  std::string name;
  std::vector<Choice> choices;
};

/// A value of a file as JSON: numbers and bools as such.
Json jsonOf(const DocumentNode& node) {
  Json out;
  switch (node.kind) {
    case DocumentNode::Kind::null:
      break;
    case DocumentNode::Kind::scalar:
      out = Json::parse(node.scalar, nullptr, false);
      if (out.is_discarded() || out.is_structured()) out = node.scalar;
      break;
    case DocumentNode::Kind::sequence:
      out = Json::array();
      for (const auto& item : node.items) out.push_back(jsonOf(*item));
      break;
    case DocumentNode::Kind::map:
      out = Json::object();
      for (const auto& entry : node.entries) out[entry.key] = jsonOf(*entry.value);
      break;
  }
  return out;
}

/// Where the scene has the material of the tool or of a body.
std::string materialKey(const StudyConfig& study, const SceneConfig& scene, const MaterialVariant& material) {
  if (material.of == "tool") return "tool.material.";
  for (std::size_t i = 0; i < scene.bodies.size(); ++i)
    if (scene.bodies[i].name == material.of) return fmt::format("bodies.{}.material.", i);
  throw InputError(study.file.string(), "materials",
                   fmt::format("{} is of \"{}\", and {} has no such body", material.name, material.of, scene.name));
}

SceneEdit edit(const std::string& key, const std::string& value) { return {key, scalarNode(value)}; }

Choice handChoice(const HandStiffness& hand) {
  Choice out{toString(hand),
             {edit("device.type", "simulated"), edit("device.hand_stiffness", fmt::format("{}", hand.stiffness)),
              edit("device.hand_damping", fmt::format("{}", hand.damping))}};
  if (hand.stiffness == 0 && hand.damping == 0) {
    out.edits.push_back(edit("device.hand_rotational_stiffness", "0"));
    out.edits.push_back(edit("device.hand_rotational_damping", "0"));
  }
  return out;
}

/// What the cases of one scene vary.
std::vector<Axis> axesOf(const StudyConfig& study, const SceneConfig& scene) {
  std::vector<Axis> axes;
  const auto add = [&](const std::string& name, const auto& values, const auto& choice) {
    if (values.empty()) return;
    Axis& axis = axes.emplace_back();
    axis.name = name;
    for (const auto& value : values) axis.choices.push_back(choice(value));
  };
  add("material", study.materials, [&](const MaterialVariant& material) {
    Choice out{material.name, {}};
    const std::string at = materialKey(study, scene, material);
    for (const auto& [key, value] : material.values) out.edits.push_back({at + key, value});
    return out;
  });
  for (const KeyVariants& variants : study.vary) {
    add(variants.key, variants.values, [&](const DocumentNode::Pointer& value) {
      return Choice{jsonOf(*value), {{variants.key, value}}};
    });
  }
  if (study.kind != CaseKind::evaluate) {
    add("method", study.methods, [](const std::string& method) { return Choice{method, {edit("method", method)}}; });
    add("visual_dt", study.visual_steps, [](double step) {
      return Choice{step, {edit("visual.step", fmt::format("{}", step))}};
    });
    add("hand", study.hands, handChoice);
  }
  add("seed", study.seeds, [](std::uint64_t seed) { return Choice{seed, {edit("seed", fmt::format("{}", seed))}}; });
  return axes;
}

/// Calls f with one choice of each axis, the last one changing fastest.
void forEachCombination(const std::vector<Axis>& axes,
                        const std::function<void(const std::vector<const Choice*>&)>& f) {
  std::vector<const Choice*> chosen;
  const std::function<void(std::size_t)> choose = [&](std::size_t at) {
    if (at == axes.size()) return f(chosen);
    for (const Choice& choice : axes[at].choices) {
      chosen.push_back(&choice);
      choose(at + 1);
      chosen.pop_back();
    }
  };
  choose(0);
}

StudySettings evaluateSettings(const StudyConfig& study) {
  StudySettings out;
  if (!study.methods.empty()) out.methods = study.methods;
  if (!study.visual_steps.empty()) out.visual_steps = study.visual_steps;
  out.reference_check = study.settings.reference_check;
  return out;
}

Json settingsJson(const StudyConfig& study) {
  const CaseSettings& s = study.settings;
  switch (study.kind) {
    case CaseKind::run:
      return {{"tables", runTablesNames()[static_cast<std::size_t>(s.tables)]}};
    case CaseKind::evaluate: {
      const StudySettings given = evaluateSettings(study);
      Json hands = Json::array();
      for (const HandStiffness& hand : study.hands) hands.push_back(toString(hand));
      return {{"methods", given.methods},
              {"visual_steps", given.visual_steps},
              {"hands", hands},
              {"reference_check", given.reference_check},
              {"pages", s.pages}};
    }
    case CaseKind::stress:
      return {{"hand", s.riding ? "ride" : "wild"},
              {"steps", s.steps},
              {"rides", s.rides},
              {"speed", s.motion.speed},
              {"spin", s.motion.spin},
              {"ride", s.motion.ride},
              {"static", s.solve_static}};
  }
  return {};
}

/// What a case cannot be: its result would depend on the machine.
void checkCase(const StudyConfig& study, const SceneConfig& scene) {
  if (isHardware(scene.device.kind))
    throw InputError(scene.file.string(), "device.type", "a study has no hand to hold a device on a desk");
  if (scene.visual_step_auto)
    throw InputError(scene.file.string(), "visual.step",
                     "auto is what a machine can hold; a study needs a number (visual_steps, or set visual.step)");
  if (study.kind == CaseKind::evaluate) checkStudy(scene, evaluateSettings(study));
  if (study.kind == CaseKind::evaluate && !study.hands.empty() && scene.tool.chosenHandle().hand.keyframes.empty())
    throw InputError(scene.file.string(), "", "its hand has no keyframes, which hands need");
}

/// Names for the files that scenes name: files/STEM-DIGEST.EXTENSION in the study's folder.
class Files {
 public:
  explicit Files(std::vector<std::pair<fs::path, std::string>>& placed) : placed_(placed) {}

  std::string nameOf(const fs::path& path) {
    std::string& name = names_[path];
    if (!name.empty()) return name;
    const std::string stem = fmt::format("{}-{}", path.stem().string(), digestOf(fileBytes(path)).substr(0, 8));
    name = "files/" + stem + path.extension().string();
    placed_.emplace_back(path, name);
    // what belongs to it, by its stem: a mesh of TetGen is two files, glTF keeps its numbers beside it
    for (const char* extension : {".node", ".ele", ".bin"}) {
      fs::path other = path;
      other.replace_extension(extension);
      if (other != path && fs::is_regular_file(other)) placed_.emplace_back(other, "files/" + stem + extension);
    }
    return name;
  }

 private:
  std::vector<std::pair<fs::path, std::string>>& placed_;
  std::map<fs::path, std::string> names_;
};

SceneConfig sceneFor(const StudyConfig& study, const SceneConfig& scene, const std::vector<SceneEdit>& edits,
                     const Json& axes) {
  try {
    SceneConfig out = edits.empty() ? scene : editedScene(scene, edits);
    checkCase(study, out);
    return out;
  } catch (const InputError& e) {
    const std::string which = axes.dump(-1, ' ', false, Json::error_handler_t::replace);  // its bytes may be no UTF-8
    throw InputError(study.file.string(), "", fmt::format("the case {}: {}", printable(which, 160), e.what()));
  }
}

fs::path sceneFile(const StudyConfig& study, const std::string& scene) {
  return (study.file.parent_path() / scene).lexically_normal();
}

std::string textOf(const Json& json) { return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n"; }

}  // namespace

std::vector<PlannedCase> planCases(const StudyConfig& study, std::vector<std::pair<fs::path, std::string>>& placed) {
  std::vector<PlannedCase> cases;
  Files files(placed);
  std::set<std::string> names;
  std::vector<SceneEdit> set;
  for (const KeyVariants& given : study.set) set.push_back({given.key, given.values.front()});
  for (const std::string& file : study.scenes) {
    const SceneConfig scene = readScene(sceneFile(study, file));
    if (!names.insert(scene.name).second)
      throw InputError(study.file.string(), "scenes", fmt::format("two of them have the name {}", scene.name));
    const std::vector<Axis> axes = axesOf(study, scene);
    forEachCombination(axes, [&](const std::vector<const Choice*>& chosen) {
      if (cases.size() == kMostCases)
        throw InputError(study.file.string(), "", fmt::format("has more than {} cases", kMostCases));
      PlannedCase& planned = cases.emplace_back();
      planned.number = static_cast<int>(cases.size());
      planned.axes["scene"] = scene.name;
      std::vector<SceneEdit> edits = set;
      for (std::size_t k = 0; k < axes.size(); ++k) {
        planned.axes[axes[k].name] = chosen[k]->name;
        edits.insert(edits.end(), chosen[k]->edits.begin(), chosen[k]->edits.end());
      }
      const SceneConfig config = sceneFor(study, scene, edits, planned.axes);
      planned.scene = sceneTextWithFiles(config, [&](const fs::path& path) { return "../../" + files.nameOf(path); });
      planned.job = {{"palpate_case", 1},      {"study", study.name},
                     {"case", planned.number}, {"kind", caseKindNames()[static_cast<std::size_t>(study.kind)]},
                     {"axes", planned.axes},   {"settings", settingsJson(study)}};
    });
  }
  return cases;
}

int writePlan(const StudyConfig& study, const fs::path& folder) {
  std::vector<std::pair<fs::path, std::string>> placed;
  const std::vector<PlannedCase> cases = planCases(study, placed);
  const OutputFolder out(folder);
  std::error_code failed;
  const auto make = [&](const fs::path& path) {
    fs::create_directories(path, failed);
    if (failed) throw InputError(path.string(), "", "cannot make this folder: " + failed.message());
  };
  if (!placed.empty()) make(folder / "files");
  for (const auto& [from, name] : placed) writeIfOther(folder / name, fileBytes(from));
  Json list = Json::array();
  for (const PlannedCase& planned : cases) {
    const fs::path at = caseFolder(folder, planned.number);
    make(at);
    writeIfOther(at / "scene.yaml", planned.scene);
    writeIfOther(at / "case.json", textOf(planned.job));
    list.push_back(planned.axes);
  }
  writeIfOther(folder / "study.yaml", fileBytes(study.file));
  const int count = static_cast<int>(cases.size());
  writeEngines(folder, study.name, count);
  writeIfOther(folder / "study.json", textOf({{"palpate_study", 1},
                                              {"name", study.name},
                                              {"description", study.description},
                                              {"kind", caseKindNames()[static_cast<std::size_t>(study.kind)]},
                                              {"cases", list}}));
  return count;
}

StudyPlan readPlan(const fs::path& folder) {
  const fs::path file = folder / "study.json";
  std::error_code ignored;
  if (!fs::is_regular_file(file, ignored))
    throw InputError(folder.string(), "", "holds no planned study (study.json); see palpate study plan");
  try {
    const Json json = Json::parse(fileBytes(file));
    StudyPlan plan;
    if (json.at("palpate_study") != 1) throw InputError(file.string(), "palpate_study", "is of another version");
    plan.name = json.at("name").get<std::string>();
    plan.description = json.at("description").get<std::string>();
    const auto kind = std::find(caseKindNames().begin(), caseKindNames().end(), json.at("kind").get<std::string>());
    if (kind == caseKindNames().end()) throw InputError(file.string(), "kind", "is not known");
    plan.kind = static_cast<CaseKind>(kind - caseKindNames().begin());
    for (const Json& axes : json.at("cases")) plan.axes.push_back(axes);
    return plan;
  } catch (const Json::exception& e) {
    throw InputError(file.string(), "", fmt::format("is no plan of a study: {}", e.what()));
  }
}

fs::path caseFolder(const fs::path& folder, int number) { return folder / "cases" / fmt::format("{:04}", number); }

}  // namespace palpate
