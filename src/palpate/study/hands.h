#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "palpate/study/evaluate.h"

namespace palpate {

/// A hand that holds a simulated device: a spring and a damper to where it wants to be; neither: nobody holds it.
struct HandStiffness {
  double stiffness = 500;  ///< [N/m]
  double damping = 8;      ///< [N s/m]
};

struct HandsSettings {
  std::vector<HandStiffness> hands;
  double settle = 2.0;  ///< from the hold on until it is judged [s]
  double watch = 1.0;   ///< that long [s]
};

/// How a run in a hand held still: largest swing of a component of force and of the device's position.
struct Hold {
  double force = 0;     ///< peak to peak [N]
  double position = 0;  ///< peak to peak [m]
  double given = 0;     ///< energy given to the hand in the whole run [J]
};

/// One hand, method, visual step and delay, beside the same hand on the reference.
struct HandRow {
  HandStiffness hand;
  std::string method;
  double visual_step = 0;  ///< [s]
  Delay delay;
  Hold hold, reference;
  TraceError error;           ///< against the reference in the same hand
  double reference_peak = 0;  ///< [N]
};

struct HandStudy {
  SceneConfig config;
  double hold_time = 0;  ///< from which on the hand stands still [s]
  std::vector<HandRow> rows;
};

/// A scene's study with hands in the loop: the device's mass in each hand follows the keyframes up to the one at which
/// the reference's force along them is nearest to its peak, and holds there. What swings then is the method's.
/// @param given  the scene's study along the given motion
/// @throws InputError for a scene whose hand has no keyframes; RunError if a reference fails
HandStudy evaluateHands(
    const SceneStudy& given, const StudySettings& study, const HandsSettings& settings,
    const std::function<void(double)>& progress = [](double) {});

/// "500/8" in N/m and N s/m, or "none"; nothing for what is no hand.
std::optional<HandStiffness> parseHand(const std::string& text);
/// The same. @throws InputError naming the option
HandStiffness handFrom(const std::string& text);
std::string toString(const HandStiffness& hand);

/// The rows for summary.json.
nlohmann::ordered_json handsJson(const std::vector<HandStudy>& studies);
/// Rows as a table for the terminal.
std::string handTable(const std::vector<HandStudy>& studies);

}  // namespace palpate
