#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "palpate/cases/study_file.h"

namespace palpate {

// A planned study is a folder:
//
//     study.json             what it is, and for each case what it varies
//     study.yaml             the study's file, as it was
//     cases/0001/case.json   all that a case does ...
//     cases/0001/scene.yaml  ... with this scene; files that it names are in files/
//     cases/0001/result/     once it is done (case_run.h)
//     cases/0001/failed.json after it failed

/// A case of a study: its scene, and what is done with it.
struct PlannedCase {
  int number = 0;               ///< from 1
  nlohmann::ordered_json axes;  ///< what it varies, by name: scene, material, keys, method, visual_dt, hand, seed
  nlohmann::ordered_json job;   ///< content of case.json
  std::string scene;            ///< content of scene.yaml
};

/// All cases: every combination of what the study varies, in the order of its keys in docs/studies.md, the last one
/// fastest. Methods, visual steps and hands of an `evaluate` are all in one case, as they share a reference.
/// @param placed  gets the absolute paths of the files that scenes name, with their names in the study's folder
/// @throws InputError for a scene that cannot be read, or would not be with a value of the study, or cannot be run so
std::vector<PlannedCase> planCases(const StudyConfig& study,
                                   std::vector<std::pair<std::filesystem::path, std::string>>& placed);

/// Plans a study into a folder. In one that holds a plan already, cases that stay as they were keep their results.
/// @return number of cases
int writePlan(const StudyConfig& study, const std::filesystem::path& folder);

/// study.json of a planned study. @throws InputError where the folder holds none
struct StudyPlan {
  std::string name, description;
  CaseKind kind = CaseKind::run;
  std::vector<nlohmann::ordered_json> axes;  ///< of case k + 1
  int cases() const { return static_cast<int>(axes.size()); }
};
StudyPlan readPlan(const std::filesystem::path& folder);

/// The folder of a case, such as FOLDER/cases/0001.
std::filesystem::path caseFolder(const std::filesystem::path& folder, int number);

}  // namespace palpate
