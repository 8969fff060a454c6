#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/results/run_files.h"
#include "palpate/scene/document.h"
#include "palpate/study/hands.h"
#include "palpate/study/stress_hand.h"

namespace palpate {

// A parameter study as its file states it; docs/studies.md describes the keys.

/// What is done in each case: the commands of the same names.
enum class CaseKind { run, evaluate, stress };
const std::vector<std::string>& caseKindNames();

/// Keys of a material, given to one body.
struct MaterialVariant {
  std::string name;
  std::string of;                                                     ///< tool, or a body's name
  std::vector<std::pair<std::string, DocumentNode::Pointer>> values;  ///< by key: youngs_modulus, ...
};

/// Values for a key of the scene.
struct KeyVariants {
  std::string key;
  std::vector<DocumentNode::Pointer> values;
};

struct CaseSettings {
  // run
  RunTables tables = RunTables::none;
  // evaluate
  bool reference_check = false;
  bool pages = false;  ///< each case keeps its report.html
  // stress
  bool riding = false;
  int steps = 0;  ///< 0: as usual
  int rides = 0;  ///< 0: as usual
  StressMotion motion;
  bool solve_static = false;
};

struct StudyConfig {
  std::filesystem::path file;
  std::string name, description;
  CaseKind kind = CaseKind::run;
  std::vector<std::string> scenes;  ///< files, relative to the study's folder
  std::vector<KeyVariants> set;     ///< one value each
  std::vector<MaterialVariant> materials;
  std::vector<KeyVariants> vary;
  std::vector<std::string> methods;
  std::vector<double> visual_steps;  ///< [s]
  std::vector<HandStiffness> hands;
  std::vector<std::uint64_t> seeds;
  CaseSettings settings;
};

/// Reads and checks a study; the scenes that it names are not looked at. @throws InputError (file, key path, cause)
StudyConfig readStudy(const std::filesystem::path& file);
StudyConfig readStudyFromString(std::string_view text, const std::string& name);

/// JSON Schema of studies.
nlohmann::ordered_json studySchema();

}  // namespace palpate
