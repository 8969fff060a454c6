#include "palpate/cases/case_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "palpate/cases/case_run.h"
#include "palpate/cases/files.h"
#include "palpate/cases/plan.h"
#include "palpate/common/error.h"
#include "palpate/record/csv_writer.h"
#include "palpate/record/output_folder.h"
#include "palpate/record/report.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::size_t kMostSeries = 8;  // of a plot
constexpr std::size_t kMostPlots = 12;

// In tables to be read, as far as they are there; table.csv has all.
const std::vector<std::string> kRunColumns{
    "force.peak_N",  "force.rms_N", "force.delivered_J",    "contact.max_active", "contact.max_penetration_m",
    "visual.redone", "visual.cut",  "visual.not_converged", "visual.restored"};
const std::vector<std::string> kEvaluateColumns{
    "method", "visual_dt",   "hand",    "rms_N",     "peak_error_N",     "drag_N",
    "rms_Nm", "floor_rms_N", "onset_s", "hold_pk_N", "reference_peak_N", "half_step_rms_N"};
const std::vector<std::string> kStressColumns{"steps",         "deepest_penetration_rel",
                                              "wrong_side",    "self_intersections",
                                              "inverted",      "nan",
                                              "frozen",        "restored",
                                              "not_converged", "redone",
                                              "cut",           "energy_made_J",
                                              "rides.ridden",  "rides.failed",
                                              "failures"};
// Drawn over what the study varies.
const std::vector<std::string> kDrawn{"force.peak_N", "contact.max_penetration_m", "rms_N",        "rms_Nm", "drag_N",
                                      "hold_pk_N",    "deepest_penetration_rel",   "energy_made_J"};

const std::vector<std::string>& mainColumns(CaseKind kind) {
  switch (kind) {
    case CaseKind::run:
      return kRunColumns;
    case CaseKind::evaluate:
      return kEvaluateColumns;
    default:
      return kStressColumns;
  }
}

/// Columns of numbers and texts, in the order in which they first came.
class Rows {
 public:
  void begin(int number, const Json& axes) {
    rows_.emplace_back();
    set("case", number);
    for (const auto& [key, value] : axes.items()) set(key, value.is_structured() ? Json(value.dump()) : value);
  }
  void set(const std::string& column, const Json& value) {
    if (std::find(columns.begin(), columns.end(), column) == columns.end()) columns.push_back(column);
    rows_.back()[column] = value;
  }
  /// All that is in it, names of what is nested with dots between; lists of texts become one.
  void setAll(const Json& json, const std::string& before = "") {
    for (const auto& [key, value] : json.items()) {
      if (value.is_object()) {
        setAll(value, before + key + ".");
      } else if (value.is_array()) {
        set(before + key, listText(value));
      } else {
        set(before + key, value);
      }
    }
  }
  std::size_t size() const { return rows_.size(); }
  /// Null where the row has none.
  Json at(std::size_t row, const std::string& column) const {
    const auto found = rows_[row].find(column);
    return found == rows_[row].end() ? Json() : found->second;
  }
  bool has(const std::string& column) const {
    return std::find(columns.begin(), columns.end(), column) != columns.end();
  }
  Json json() const {
    Json out = Json::array();
    for (std::size_t r = 0; r < rows_.size(); ++r) {
      Json row = Json::object();
      for (const std::string& column : columns)
        if (const auto found = rows_[r].find(column); found != rows_[r].end()) row[column] = found->second;
      out.push_back(std::move(row));
    }
    return out;
  }

  std::vector<std::string> columns;

 private:
  static std::string listText(const Json& list) {
    std::string out;
    for (const Json& item : list)
      out += (out.empty() ? "" : "; ") + (item.is_string() ? item.get<std::string>() : item.dump());
    return out;
  }

  std::vector<std::map<std::string, Json>> rows_;
};

std::string exactText(const Json& value) {
  if (value.is_null()) return "";
  if (value.is_number_float()) return shortest(value.get<double>());
  return value.is_string() ? value.get<std::string>() : value.dump();
}

std::string shortText(const Json& value) {
  if (value.is_null()) return "-";
  if (!value.is_number_float()) return exactText(value);
  const double number = value.get<double>();
  return number == 0 ? "0" : fmt::format("{:.4g}", number);
}

void writeCsv(const fs::path& path, const Rows& rows) {
  CsvWriter csv(path, rows.columns);
  for (std::size_t r = 0; r < rows.size(); ++r) {
    for (const std::string& column : rows.columns) csv.cell(std::string_view(exactText(rows.at(r, column))));
    csv.endRow();
  }
  csv.close();
}

/// The columns of the tables to be read: what is varied, then the main numbers that there are.
std::vector<std::string> readColumns(const StudyPlan& plan, const Rows& rows) {
  std::vector<std::string> out{"case"};
  for (const Json& axes : plan.axes)
    for (const auto& [key, value] : axes.items())
      if (std::find(out.begin(), out.end(), key) == out.end()) out.push_back(key);
  for (const std::string& column : mainColumns(plan.kind))
    if (rows.has(column) && std::find(out.begin(), out.end(), column) == out.end()) out.push_back(column);
  return out;
}

/// What of an axis a row has, as far as it is a number.
std::optional<double> numberAt(const Rows& rows, std::size_t row, const std::string& column) {
  const Json value = rows.at(row, column);
  if (!value.is_number()) return std::nullopt;
  return value.get<double>();
}

/// Of what is varied, that with the most numbers, if there are several.
std::string drawnOver(const Rows& rows, const std::vector<std::string>& varied) {
  std::string best;
  std::size_t most = 1;
  for (const std::string& column : varied) {
    if (column == "case" || column == "seed") continue;
    std::set<double> values;
    bool numbers = true;
    for (std::size_t r = 0; r < rows.size(); ++r) {
      const auto value = numberAt(rows, r, column);
      numbers = numbers && value.has_value();
      if (value) values.insert(*value);
    }
    if (!numbers || values.size() <= most) continue;
    most = values.size();
    best = column;
  }
  return best;
}

/// A main number over one that is varied: a line for each combination of the others, the mean over seeds.
std::optional<Plot> plotOf(const Rows& rows, const std::string& what, const std::string& over,
                           const std::vector<std::string>& varied) {
  std::map<std::string, std::map<double, std::pair<double, int>>> lines;
  std::set<double> at;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const auto x = numberAt(rows, r, over), y = numberAt(rows, r, what);
    if (!x || !y) continue;
    std::string name;
    for (const std::string& column : varied) {
      if (column == over || column == "seed" || column == "case") continue;
      const Json value = rows.at(r, column);
      if (!value.is_null()) name += (name.empty() ? "" : ", ") + shortText(value);
    }
    at.insert(*x);
    auto& [sum, count] = lines[name][*x];
    sum += *y;
    ++count;
  }
  if (at.size() < 2 || lines.size() > kMostSeries) return std::nullopt;
  Plot plot;
  plot.title = fmt::format("{} over {}", what, over);
  plot.y_label = what;
  plot.x_label = over;
  plot.x.assign(at.begin(), at.end());
  plot.half_width = true;
  for (const auto& [name, points] : lines) {
    Series series;
    series.name = name.empty() ? what : name;
    for (const double x : at) {
      const auto found = points.find(x);
      series.values.push_back(found == points.end() ? std::nan("") : found->second.first / found->second.second);
    }
    plot.series.push_back(std::move(series));
  }
  return plot;
}

std::string stateText(const StudyState& state) {
  std::string out = fmt::format("{} of {} cases are done", state.done, state.cases);
  if (!state.missing.empty()) out += fmt::format("; missing: {}", numbersText(state.missing));
  std::vector<int> failed;
  for (const auto& [number, cause] : state.failed) failed.push_back(number);
  if (!failed.empty()) out += fmt::format("; failed: {}", numbersText(failed));
  if (!state.below.empty()) out += fmt::format("; criteria not met: {}", numbersText(state.below));
  return out;
}

/// Of Markdown: nothing that ends a cell or a line.
std::string cellText(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  for (std::size_t at = text.find('|'); at != std::string::npos; at = text.find('|', at + 2))
    text.replace(at, 1, "\\|");
  return text;
}

std::string markdown(const StudyPlan& plan, const StudyState& state, const Rows& rows,
                     const std::vector<std::string>& columns) {
  std::string out = fmt::format("# {}\n\n", plan.name);
  if (!plan.description.empty()) out += plan.description + "\n\n";
  out += stateText(state) + ".\n";
  for (const auto& [number, cause] : state.failed) out += fmt::format("\n- case {} failed: {}", number, cause);
  out += state.failed.empty() ? "\n" : "\n\n";
  std::string rule;
  for (const std::string& column : columns) {
    out += "| " + column + " ";
    rule += "| --- ";
  }
  out += "|\n" + rule + "|\n";
  for (std::size_t r = 0; r < rows.size(); ++r) {
    for (const std::string& column : columns) out += "| " + cellText(shortText(rows.at(r, column))) + " ";
    out += "|\n";
  }
  return out;
}

Report page(const StudyPlan& plan, const StudyState& state, const Rows& rows, const std::vector<std::string>& columns,
            const std::string& programs) {
  Report out;
  out.title = fmt::format("Palpate: study {}", plan.name);
  out.subtitle = plan.description;
  Table standing{"Cases", {"", ""}, {}, "", {}};
  standing.rows = {{"done", fmt::format("{} of {}", state.done, state.cases)}};
  const auto bad = [&](const std::string& what, const std::string& which) {
    standing.bad.push_back(standing.rows.size());
    standing.rows.push_back({what, which});
  };
  if (!state.missing.empty()) bad("missing", numbersText(state.missing));
  for (const auto& [number, cause] : state.failed) bad(fmt::format("case {} failed", number), cause);
  if (!state.below.empty()) bad("criteria not met", numbersText(state.below));
  standing.note = programs;
  out.tables.push_back(std::move(standing));
  Table table{"Results", columns, {}, "", {}};
  for (std::size_t r = 0; r < rows.size(); ++r) {
    if (!exactText(rows.at(r, "failures")).empty()) table.bad.push_back(r);
    std::vector<std::string> cells;
    for (const std::string& column : columns) cells.push_back(shortText(rows.at(r, column)));
    table.rows.push_back(std::move(cells));
  }
  out.tables.push_back(std::move(table));
  std::vector<std::string> varied;
  for (const std::string& column : columns)
    if (std::find(mainColumns(plan.kind).begin(), mainColumns(plan.kind).end(), column) ==
            mainColumns(plan.kind).end() ||
        column == "method" || column == "visual_dt" || column == "hand")
      varied.push_back(column);
  if (const std::string over = drawnOver(rows, varied); !over.empty()) {
    for (const std::string& what : kDrawn) {
      if (!rows.has(what) || out.plots.size() == kMostPlots) continue;
      if (auto plot = plotOf(rows, what, over, varied)) out.plots.push_back(std::move(*plot));
    }
  }
  out.footer = "Written by palpate study report. All numbers: table.csv, summary.json; times: timings.csv.";
  return out;
}

Json resultIn(const fs::path& file) {
  try {
    return Json::parse(fileBytes(file));
  } catch (const Json::exception&) {
    throw InputError(file.string(), "", "is damaged; run the case again (--again)");
  }
}

/// The rows of a case that is done.
void addCase(const StudyPlan& plan, int number, const fs::path& result, Rows& rows) {
  const Json summary = resultIn(result / "summary.json");
  const Json& axes = plan.axes[static_cast<std::size_t>(number - 1)];
  if (plan.kind != CaseKind::evaluate) {
    rows.begin(number, axes);
    rows.setAll(summary);
    return;
  }
  for (const Json& row : summary.at("rows")) {
    rows.begin(number, axes);
    rows.setAll(row);
    for (const auto& [key, value] : summary.at("references").at(0).items())
      if (key.starts_with("half_step_")) rows.set(key, value);
  }
}

}  // namespace

std::string numbersText(const std::vector<int>& numbers) {
  std::string out;
  for (std::size_t i = 0; i < numbers.size();) {
    std::size_t last = i;
    while (last + 1 < numbers.size() && numbers[last + 1] == numbers[last] + 1) ++last;
    if (!out.empty()) out += ", ";
    out += last > i + 1 ? fmt::format("{} to {}", numbers[i], numbers[last]) : fmt::format("{}", numbers[i]);
    i = last > i + 1 ? last + 1 : i + 1;
  }
  return out;
}

StudyState reportStudy(const fs::path& folder) {
  const StudyPlan plan = readPlan(folder);
  StudyState state;
  state.name = plan.name;
  state.cases = plan.cases();
  Rows rows, times;
  std::set<std::string> programs;
  for (int number = 1; number <= plan.cases(); ++number) {
    const CaseState now = caseState(folder, number);
    if (now.kind == CaseState::Kind::missing) state.missing.push_back(number);
    if (now.kind == CaseState::Kind::failed) state.failed.emplace_back(number, now.cause);
    if (now.kind != CaseState::Kind::done) continue;
    ++state.done;
    programs.insert(now.program);
    const fs::path result = caseFolder(folder, number) / "result";
    const std::size_t first = rows.size();
    addCase(plan, number, result, rows);
    if (rows.size() > first && !exactText(rows.at(first, "failures")).empty()) state.below.push_back(number);
    times.begin(number, plan.axes[static_cast<std::size_t>(number - 1)]);
    times.setAll(resultIn(result / "timing.json"));
  }
  if (rows.columns.empty()) rows.columns = {"case"};
  if (times.columns.empty()) times.columns = {"case"};
  const std::vector<std::string> columns = readColumns(plan, rows);
  const std::string made = programs.size() > 1 ? fmt::format("Made by {} different programs.", programs.size()) : "";
  OutputFolder out(folder);
  writeCsv(out.stage("table.csv"), rows);
  writeCsv(out.stage("timings.csv"), times);
  writeWhole(out.stage("table.md"), markdown(plan, state, rows, columns));
  writeReport(out.stage("report.html"), page(plan, state, rows, columns, made));
  Json failed = Json::array();
  for (const auto& [number, cause] : state.failed) failed.push_back({{"case", number}, {"cause", cause}});
  writeJson(out.stage("summary.json"), {{"study", plan.name},
                                        {"kind", caseKindNames()[static_cast<std::size_t>(plan.kind)]},
                                        {"cases", state.cases},
                                        {"done", state.done},
                                        {"missing", state.missing},
                                        {"failed", failed},
                                        {"criteria_not_met", state.below},
                                        {"programs", programs.size()},
                                        {"rows", rows.json()}});
  out.commit();
  return state;
}

}  // namespace palpate
