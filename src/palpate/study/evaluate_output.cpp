#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"
#include "palpate/record/report.h"
#include "palpate/record/text_table.h"
#include "palpate/study/evaluate.h"

namespace palpate {
namespace {

constexpr std::size_t kMostPlotRows = 2500;  // a study has many plots; a screen shows no more

template <typename T>
nlohmann::ordered_json orNull(const std::optional<T>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json(nullptr);
}

std::string orDash(const std::optional<double>& value, const char* form, double scale = 1.0) {
  return value ? fmt::format(fmt::runtime(form), scale * *value) : "-";
}

nlohmann::ordered_json rowJson(const SceneStudy& study, const StudyRow& row) {
  return {{"scene", study.config.name},
          {"method", row.method},
          {"visual_dt", row.visual_step},
          {"latency", row.delay.latency},
          {"jitter", row.delay.jitter},
          {"aim", toString(study.config.aim)},
          {"derivative", toString(study.config.derivative)},
          {"rms_N", row.error.rms_force},
          {"peak_error_N", row.error.peak_force},
          {"peak_error_x_N", row.error.peak_force_axes.x()},
          {"peak_error_y_N", row.error.peak_force_axes.y()},
          {"peak_error_z_N", row.error.peak_force_axes.z()},
          {"drag_N", orNull(row.drag)},
          {"rms_Nm", row.error.rms_torque},
          {"peak_error_Nm", row.error.peak_torque},
          {"reference_peak_N", study.reference_peak},
          {"floor_rms_N", row.floor_rms},
          {"floor_rms_Nm", row.floor_rms_torque},
          {"onset_s", orNull(row.onset)},
          {"release_s", orNull(row.release)},
          {"glue_Ns", orNull(row.glue)},
          {"switch_N", row.switch_step},
          {"returned_J", row.returned},
          {"reference_returned_J", study.reference_returned},
          {"failed_steps", row.restored}};
}

nlohmann::ordered_json referenceJson(const SceneStudy& study) {
  nlohmann::ordered_json segments = nlohmann::ordered_json::array();
  for (const TickRange& s : study.segments) {
    segments.push_back({static_cast<double>(s.first) * study.config.haptic_step,
                        static_cast<double>(s.last) * study.config.haptic_step});
  }
  nlohmann::ordered_json j{{"scene", study.config.name},
                           {"handle", study.config.tool.handle},
                           {"visual_dt", study.config.haptic_step},
                           {"peak_N", study.reference_peak},
                           {"returned_J", study.reference_returned},
                           {"contact_s", orNull(study.contact_time)},
                           {"release_s", orNull(study.release_time)},
                           {"drag_segments_s", segments}};
  if (study.reference_error) {
    j["half_step_rms_N"] = study.reference_error->rms_force;
    j["half_step_peak_N"] = study.reference_error->peak_force;
    j["half_step_rms_Nm"] = study.reference_error->rms_torque;
  }
  return j;
}

const std::vector<std::string> kHeader{"scene",   "method",  "visual, ms", "latency",   "RMS, N",     "peak error, N",
                                       "drag, N", "RMS, Nm", "floor, N",   "onset, ms", "returned, J"};

std::vector<std::string> cells(const SceneStudy& study, const StudyRow& row) {
  return {study.config.name,
          row.method,
          fmt::format("{:g}", 1e3 * row.visual_step),
          toString(row.delay),
          fmt::format("{:.4f}", row.error.rms_force),
          fmt::format("{:.3f}", row.error.peak_force),
          orDash(row.drag, "{:+.4f}"),
          fmt::format("{:.5f}", row.error.rms_torque),
          fmt::format("{:.4f}", row.floor_rms),
          orDash(row.onset, "{:.0f}", 1e3),
          fmt::format("{:+.4f}", row.returned)};
}

// Why columns of a study hold dashes; empty where none does.
std::string dashLine(const SceneStudy& study) {
  const auto missing = [&](auto member) {
    return std::any_of(study.rows.begin(), study.rows.end(), [&](const StudyRow& row) { return !(row.*member); });
  };
  std::string line;
  if (study.segments.empty() && missing(&StudyRow::drag)) {
    line += "; no drag (-), as the hand nowhere moves freely at a steady speed for 0.3 s";
  }
  if (!study.contact_time && missing(&StudyRow::onset)) {
    line += "; no onset (-), as no contact begins in the motion";
  } else if (missing(&StudyRow::onset)) {
    line += "; no onset (-) where the force does not rise by a tenth of its peak after the first contact";
  }
  return line;
}

std::string referenceLine(const SceneStudy& study) {
  std::string line =
      fmt::format("{}: reference vc at {:g} ms, latency 0: peak {:.3f} N, returned {:+.4f} J", study.config.name,
                  1e3 * study.config.haptic_step, study.reference_peak, study.reference_returned);
  if (study.reference_error) {
    line += fmt::format("; against half its step RMS {:.4f} N, {:.5f} Nm", study.reference_error->rms_force,
                        study.reference_error->rms_torque);
  }
  return line + dashLine(study);
}

/// Every n-th tick.
class PlotRows {
 public:
  explicit PlotRows(const SceneStudy& study)
      : stride_(std::max<std::size_t>(1, (study.reference.size() + kMostPlotRows - 1) / kMostPlotRows)) {
    for (std::size_t i = 0; i < study.reference.size(); i += stride_) {
      time.push_back(static_cast<double>(i) * study.config.haptic_step);
    }
  }

  template <typename Value>
  std::vector<double> of(const WrenchTrace& trace, const Value& value) const {
    std::vector<double> out;
    for (std::size_t i = 0; i < trace.size(); i += stride_) out.push_back(value(i, trace[i]));
    return out;
  }

  std::vector<double> time;

 private:
  std::size_t stride_;
};

// Its method, with the delay where a study has several.
std::string labelOf(const SceneStudy& study, const StudyRow& row) {
  const std::string delay = toString(row.delay);
  const bool several = std::any_of(study.rows.begin(), study.rows.end(),
                                   [&](const StudyRow& other) { return toString(other.delay) != delay; });
  return several ? fmt::format("{}, {}", row.method, delay) : row.method;
}

template <typename Value>
Plot comparePlot(const SceneStudy& study, const PlotRows& rows, double visual_step, const std::string& title,
                 const std::string& label, bool with_reference, const Value& value) {
  Plot plot;
  plot.title = title;
  plot.y_label = label;
  plot.x = rows.time;
  plot.group = study.config.name;
  int color = 1;
  for (const StudyRow& row : study.rows) {
    if (row.visual_step != visual_step) continue;
    plot.series.push_back({labelOf(study, row), rows.of(row.trace, value), std::to_string(color++)});
  }
  if (with_reference) plot.series.push_back({"reference", rows.of(study.reference, value), "ink", true});
  return plot;
}

void addPlots(Report& page, const SceneStudy& study, double visual_step) {
  const PlotRows rows(study);
  const std::string where = fmt::format("{}, {:g} ms", study.config.name, 1e3 * visual_step);
  page.plots.push_back(comparePlot(study, rows, visual_step, where + ": size of the force", "Force, N", true,
                                   [](std::size_t, const Vec6& w) { return w.head<3>().norm(); }));
  page.plots.back().note =
      "On the hand, before the safety stage. Where the hand moves through free air, what a method adds to the "
      "reference is "
      "drag that is not there.";
  page.plots.push_back(
      comparePlot(study, rows, visual_step, where + ": error of the force", "Force, N", false,
                  [&](std::size_t i, const Vec6& w) { return (w - study.reference[i]).head<3>().norm(); }));
  const std::array<const char*, 3> axes{"x", "y", "z"};
  for (int k = 0; k < 3; ++k) {
    page.plots.push_back(comparePlot(study, rows, visual_step, where + ": force along " + axes[k], "Force, N", true,
                                     [k](std::size_t, const Vec6& w) { return w[k]; }));
    page.plots.back().half_width = true;
  }
  page.plots.push_back(
      comparePlot(study, rows, visual_step, where + ": error of the torque", "Torque, N m", false,
                  [&](std::size_t i, const Vec6& w) { return (w - study.reference[i]).tail<3>().norm(); }));
  page.plots.back().half_width = true;
}

Report studyReport(const std::vector<SceneStudy>& studies) {
  Report page;
  page.title = "Palpate: fidelity study";
  Table table{"Every method against the reference", kHeader, {}, ""};
  for (const SceneStudy& study : studies) {
    page.subtitle += (page.subtitle.empty() ? "" : "; ") +
                     fmt::format("{} held by {}, aim {}, {} derivative", study.config.name, study.config.tool.handle,
                                 toString(study.config.aim), toString(study.config.derivative));
    table.note += referenceLine(study) + ". ";
    std::vector<double> visual_steps;
    for (const StudyRow& row : study.rows) {
      table.rows.push_back(cells(study, row));
      if (visual_steps.empty() || visual_steps.back() != row.visual_step) visual_steps.push_back(row.visual_step);
    }
    for (const double visual_step : visual_steps) addPlots(page, study, visual_step);
  }
  page.tables.push_back(std::move(table));
  page.footer = "Written by palpate evaluate; docs/fidelity.md defines every column. The numbers: summary.json.";
  return page;
}

}  // namespace

std::string studyTable(const std::vector<SceneStudy>& studies) {
  std::vector<std::vector<std::string>> rows{kHeader};
  std::string out;
  for (const SceneStudy& study : studies) {
    out += referenceLine(study) + "\n";
    for (const StudyRow& row : study.rows) rows.push_back(cells(study, row));
  }
  return out + alignedColumns(rows, 2);
}

void writeStudy(const std::vector<SceneStudy>& studies, const std::filesystem::path& folder,
                const nlohmann::ordered_json& hands) {
  OutputFolder out(folder);
  nlohmann::ordered_json j;
  j["rows"] = nlohmann::ordered_json::array();
  j["references"] = nlohmann::ordered_json::array();
  for (const SceneStudy& study : studies) {
    for (const StudyRow& row : study.rows) j["rows"].push_back(rowJson(study, row));
    j["references"].push_back(referenceJson(study));
  }
  for (const auto& row : hands) j["rows"].push_back(row);
  writeReport(out.stage("report.html"), studyReport(studies));
  writeJson(out.stage("summary.json"), j);
  out.commit();
}

}  // namespace palpate
