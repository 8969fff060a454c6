#include "palpate/one_d/output.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "palpate/record/csv_writer.h"
#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"
#include "palpate/record/report.h"

namespace palpate::one_d {

namespace {

using Json = nlohmann::ordered_json;

const std::vector<std::string> kTableHeader{"Method", "Visual step, ms", "Drag, N", "RMS error, N", "Peak error, N"};

/// The measures after the name of a method.
const std::vector<std::string> kPageHeader{"drag, N", "RMS error, N", "peak error, N"};

std::string milliseconds(double seconds) { return fmt::format("{:.6g}", 1e3 * seconds); }

std::string upper(const Run& run) {
  if (run.method == "live") return "Live";
  return run.method == "vc" ? "VC" : run.method == "hsl" ? "HSL" : "Reference";
}

std::vector<std::vector<std::string>> tableRows(const Results& results) {
  std::vector<std::vector<std::string>> rows;
  for (const Run& run : results.runs) {
    rows.push_back({upper(run), milliseconds(run.visual_dt), run.drag ? fmt::format("{:.2f}", *run.drag) : "-",
                    fmt::format("{:.2f}", run.rms), fmt::format("{:.2f}", run.peak_error)});
  }
  return rows;
}

/// For the page: a row a visual step, the methods beside each other under every measure.
Table errorTable(const Results& results) {
  Table table;
  table.title = "Error against the reference";
  table.header = {kTableHeader[1]};
  const std::vector<Method>& methods = results.config.methods;
  const std::size_t steps = results.config.visual_dts.size();
  const auto rows = tableRows(results);
  for (std::size_t measure = 2; measure < kTableHeader.size(); ++measure) {
    for (std::size_t m = 0; m < methods.size(); ++m) {
      table.header.push_back(fmt::format("{} {}", upper(results.runs[m * steps]), kPageHeader[measure - 2]));
    }
  }
  for (std::size_t step = 0; step < steps; ++step) {
    std::vector<std::string> row{rows[step][1]};
    for (std::size_t measure = 2; measure < kTableHeader.size(); ++measure) {
      for (std::size_t m = 0; m < methods.size(); ++m) row.push_back(rows[m * steps + step][measure]);
    }
    table.rows.push_back(std::move(row));
  }
  table.note = fmt::format(
      "Drag: mean force in free motion towards the wall. Reference: virtual coupling at a visual step of 1 ms without "
      "latency; its force peaks at {:.2f} N.",
      results.reference_peak);
  return table;
}

void writeCsv(const Results& results, const std::filesystem::path& path) {
  CsvWriter csv(path, {"time", "method", "visual_dt", "latency", "xd", "xh", "xt", "force"});
  const auto write = [&](const Run& run) {
    const Trace& trace = run.trace;
    for (std::size_t i = 0; i < results.time.size(); ++i) {
      csv.cell(results.time[i]).cell(run.method).cell(run.visual_dt).cell(run.latency);
      csv.cell(trace.device[i]).cell(trace.handle[i]).cell(trace.tool[i]).cell(trace.force[i]);
      csv.endRow();
    }
  };
  write(results.reference);
  for (const Run& run : results.runs) write(run);
  csv.close();
}

Json configJson(const Config& config) {
  const Parameters& p = config.parameters;
  Json json{{"handle_mass", p.handle_mass},           {"tool_mass", p.tool_mass},
            {"spring_stiffness", p.spring_stiffness}, {"spring_damping", p.spring_damping},
            {"rest_length", p.rest_length},           {"link_stiffness", p.link_stiffness},
            {"link_damping", p.link_damping}};
  json["trajectory"] = Json::array();
  for (const Knot& knot : config.trajectory) json["trajectory"].push_back(Json::array({knot.t, knot.x}));
  json["haptic_dt"] = config.haptic_dt;
  json["visual_dts"] = config.visual_dts;
  json["latency"] = config.latency;
  json["methods"] = Json::array();
  for (const Method method : config.methods) json["methods"].push_back(methodName(method));
  return json;
}

Json summaryJson(const Results& results) {
  const auto drag = [](const Run& run) { return run.drag ? Json(*run.drag) : Json(); };
  Json json;
  json["reference_peak_N"] = results.reference_peak;
  json["reference_drag_N"] = drag(results.reference);
  json["runs"] = Json::array();
  for (const Run& run : results.runs) {
    json["runs"].push_back({{"method", run.method},
                            {"visual_dt", run.visual_dt},
                            {"latency", run.latency},
                            {"drag_N", drag(run)},
                            {"rms_N", run.rms},
                            {"peak_error_N", run.peak_error}});
  }
  json["config"] = configJson(results.config);
  return json;
}

/// The run whose positions are drawn: of the last method, the step nearest to 10 ms.
const Run& shownRun(const Results& results) {
  const auto distance = [](const Run& run) { return std::abs(run.visual_dt - 0.01); };
  const auto nearest = std::min_element(results.runs.rbegin(), results.runs.rend(),
                                        [&](const Run& a, const Run& b) { return distance(a) < distance(b); });
  return *nearest;
}

Plot positionPlot(const Results& results) {
  const Run& run = shownRun(results);
  Plot plot;
  plot.title = "Positions";
  plot.note = fmt::format(
      "The device pulls the handle; the tool follows it at the rest length of the spring until it meets the wall at 0. "
      "Visual step {} ms.",
      milliseconds(run.visual_dt));
  plot.y_label = "Position, m";
  plot.x = results.time;
  const std::vector<double> wall(results.time.size(), 0.0);
  plot.series = {{"device", run.trace.device, "1"},
                 {"handle", run.trace.handle, "2"},
                 {"tool", run.trace.tool, "3"},
                 {"wall", wall, "muted", true}};
  plot.group = "time";
  plot.height = 280.0;
  return plot;
}

/// One range for both panels of forces, so that they can be compared at a glance.
std::pair<double, double> forceRange(const Results& results) {
  double low = 0.0, high = 0.0;
  const auto include = [&](const Run& run) {
    for (const double force : run.trace.force) low = std::min(low, force), high = std::max(high, force);
  };
  include(results.reference);
  for (const Run& run : results.runs) include(run);
  const double margin = 0.06 * std::max(high - low, 1e-9);
  return {low - margin, high + margin};
}

Plot forcePlot(const Results& results, const std::string& method) {
  Plot plot;
  const bool vc = method == "vc";
  plot.title = vc ? "Virtual coupling (VC)" : "Handle-space linearization (HSL)";
  plot.note =
      vc ? "The coarser the visual step, the more the device drags on its way through the air: the coupling "
           "pulls back to a late handle."
         : "The force is linearized in the handle's state and evaluated every haptic tick, so free motion stays "
           "nearly free and the contact stands out.";
  plot.y_label = "Force on the device, N";
  plot.x = results.time;
  int color = 1;
  // Coarse steps first: the finer ones, and the reference above all, are drawn over them.
  for (auto run = results.runs.rbegin(); run != results.runs.rend(); ++run) {
    if (run->method != method) continue;
    plot.series.push_back({milliseconds(run->visual_dt) + " ms", run->trace.force});
  }
  for (auto series = plot.series.rbegin(); series != plot.series.rend(); ++series) {
    series->color = std::to_string((color++ - 1) % 8 + 1);
  }
  plot.series.push_back({"reference", results.reference.trace.force, "ink", true});
  plot.group = "time";
  plot.y_range = forceRange(results);
  plot.half_width = true;
  plot.height = 380.0;
  return plot;
}

Report makeReport(const Results& results) {
  Report report;
  report.title = "One-dimensional experiment";
  const double latency = results.config.latency;
  report.subtitle = fmt::format(
      "A device draws a handle and, by a spring, a tool towards a wall and back. What does the hand feel when the "
      "simulation is slow and its results arrive {} late?",
      latency == 1.0 ? "one visual step" : fmt::format("{:.6g} visual steps", latency));
  report.tables.push_back(errorTable(results));
  report.plots.push_back(positionPlot(results));
  for (const Method method : results.config.methods) report.plots.push_back(forcePlot(results, methodName(method)));
  report.footer = "Model and measures: docs/one-d.md. Every trace: one_d.csv; the figures: summary.json.";
  return report;
}

}  // namespace

void writeResults(const Results& results, const std::filesystem::path& path) {
  OutputFolder folder(path);
  writeCsv(results, folder.stage("one_d.csv"));
  writeReport(folder.stage("report.html"), makeReport(results));
  writeJson(folder.stage("summary.json"), summaryJson(results));
  folder.commit();
}

std::string tableText(const Results& results) {
  std::string out =
      fmt::format("reference: peak force {:.2f} N; latency {:.6g}\n\n", results.reference_peak, results.config.latency);
  constexpr const char* kLine = "{:<8} {:>15} {:>9} {:>13} {:>14}\n";
  out += fmt::format(kLine, kTableHeader[0], kTableHeader[1], kTableHeader[2], kTableHeader[3], kTableHeader[4]);
  for (const auto& row : tableRows(results)) out += fmt::format(kLine, row[0], row[1], row[2], row[3], row[4]);
  return out;
}

}  // namespace palpate::one_d
