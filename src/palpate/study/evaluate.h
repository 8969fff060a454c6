#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "palpate/scene/config.h"
#include "palpate/study/fidelity.h"

namespace palpate {

/// How late a step's result comes.
struct Delay {
  int latency = 1;  ///< [visual steps]
  int jitter = 0;   ///< at most that many more, by chance
};

/// What the fidelity study varies; the rest (aim, derivative, handle, ...) is the scene's.
struct StudySettings {
  std::vector<std::string> methods{"live", "hsl", "hsl-exact", "vc"};
  std::vector<double> visual_steps{0.010, 0.020, 0.033};  ///< [s]
  bool reference_check = false;                           ///< run the reference at half its step too
  std::vector<Delay> delays{};                            ///< none: the scene's
};

/// One method at one visual step and delay, against the reference.
struct StudyRow {
  std::string method;
  double visual_step = 0;  ///< [s]
  Delay delay;
  TraceError error;
  std::optional<double> drag;     ///< [N]
  std::optional<double> onset;    ///< later than the reference [s]
  std::optional<double> release;  ///< of the last contact, later than the reference [s]
  std::optional<double> glue;     ///< impulse of the force error after it [N s]
  double switch_step = 0;         ///< largest of the force at a new model, beyond the reference's [N]
  double returned = 0;            ///< [J]
  double floor_rms = 0;           ///< error of the same coarse steps, rendered ideally [N]
  double floor_rms_torque = 0;    ///< [N m]
  int restored = 0;               ///< visual steps that failed
  WrenchTrace trace;
  std::vector<char> switched;  ///< per tick: a new model came into use
};

/// A scene's study: one motion of the device, the reference, and all rows in the order visual step, method, delay.
struct SceneStudy {
  SceneConfig config;
  MotionTrace motion;
  WrenchTrace reference;
  double reference_peak = 0;                  ///< [N]
  double reference_returned = 0;              ///< [J]
  std::optional<TraceError> reference_error;  ///< against half the step, where asked for
  std::vector<TickRange> segments;            ///< on which drag is measured
  std::optional<double> contact_time;         ///< at which the reference's first contact begins [s]
  std::optional<double> release_time;         ///< at which its last one ends [s]
  std::vector<StudyRow> rows;
};

/// The scene with a method, a visual step [s] and a delay, without one its own. @throws InputError as its reader does
SceneConfig variantOf(const SceneConfig& config, const std::string& method, double visual_step,
                      const std::optional<Delay>& delay = {});
/// Those of a study of the scene: at least one.
std::vector<Delay> delaysOf(const SceneConfig& config, const StudySettings& settings);
/// "1", or "1+2" with a jitter of 2. @throws InputError naming the option
Delay delayFrom(const std::string& text);
std::string toString(const Delay& delay);

/// Whether a study can be made at all. @throws InputError naming the option
void checkStudy(const SceneConfig& config, const StudySettings& settings);

/// Runs the study of a scene, two runs at a time; the result does not depend on that. A simulated device is replaced by
/// its hand's path, so that every run has the same motion.
/// @param config    a checked scene
/// @param progress  share done, 0 to 1; called from one thread at a time
/// @throws InputError for an unknown method, a visual step that is no multiple of the haptic one, a run too long to
///         compare; RunError if the reference fails
SceneStudy evaluateScene(
    const SceneConfig& config, const StudySettings& settings,
    const std::function<void(double)>& progress = [](double) {});

/// The scene at one haptic step a visual step, no latency, virtual coupling: what the study compares with. The visual
/// handle aims at the sample, which is where the device is when the step's result is used.
SceneConfig referenceConfig(const SceneConfig& config);

/// Coarse steps, in the scene's substeps, rendered ideally: each aims at where the device is at its end, and its link's
/// wrench counts at that time; linear in between.
WrenchTrace idealRendering(const SceneConfig& config, double visual_step);

/// Rows as a table for the terminal.
std::string studyTable(const std::vector<SceneStudy>& studies);

/// Writes summary.json and report.html.
/// @param hands  more rows: of the study with hands, if there is one (hands.h)
/// @throws InputError if the folder cannot be written
void writeStudy(const std::vector<SceneStudy>& studies, const std::filesystem::path& folder,
                const nlohmann::ordered_json& hands);

}  // namespace palpate
