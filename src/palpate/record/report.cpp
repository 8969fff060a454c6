#include "palpate/record/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string_view>

#include "palpate/record/assets.h"
#include "palpate/record/decimate.h"
#include "palpate/record/json_file.h"

namespace palpate {

namespace {

// A packaged library ends by naming a file that browsers' tools would look for; the page must not look for anything.
std::string withoutSourceMap(std::string_view source) {
  constexpr std::string_view mark = "# sourceMappingURL=";
  std::string out(source);
  for (std::size_t at = out.find(mark); at != std::string::npos && at >= 2; at = out.find(mark)) {
    const bool block = out.compare(at - 2, 2, "/*") == 0;
    std::size_t end = block ? out.find("*/", at) : out.find('\n', at);
    end = end == std::string::npos ? out.size() : end + (block ? 2 : 0);
    out.erase(at - 2, end - (at - 2));
  }
  return out;
}

std::string escapeHtml(std::string_view text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

/// A JSON string that cannot end the script element around it.
std::string jsonString(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (c == '<' || static_cast<unsigned char>(c) < 0x20) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04x", static_cast<unsigned>(static_cast<unsigned char>(c)));
      out += escape;
    } else {
      out += c;
    }
  }
  return out + '"';
}

/// Enough digits for a screen; the CSV files have them all.
std::string jsonNumber(double value) {
  if (!std::isfinite(value)) return "null";
  char digits[32];
  std::snprintf(digits, sizeof digits, "%.7g", value);
  return digits;
}

bool looksNumeric(std::string_view cell) {
  return cell.empty() || cell == "-" || cell == "–" ||
         ((cell[0] >= '0' && cell[0] <= '9') || ((cell[0] == '-' || cell[0] == '+') && cell.size() > 1));
}

/// Columns of numbers are right-aligned, headers included.
std::vector<bool> numericColumns(const Table& table) {
  std::vector<bool> numeric(table.header.size(), !table.rows.empty());
  for (const auto& row : table.rows) {
    for (std::size_t i = 0; i < row.size() && i < numeric.size(); ++i) {
      if (!looksNumeric(row[i])) numeric[i] = false;
    }
  }
  return numeric;
}

void appendTable(std::string& html, const Table& table) {
  const std::vector<bool> numeric = numericColumns(table);
  const auto align = [&](std::size_t i) { return i < numeric.size() && numeric[i] ? " class=\"number\"" : ""; };
  html += fmt::format(
      "<figure class=\"card table\">\n<div class=\"scroll\" tabindex=\"0\"><table>\n<caption>{}</caption>\n",
      escapeHtml(table.title));
  const bool named = std::any_of(table.header.begin(), table.header.end(), [](const auto& h) { return !h.empty(); });
  if (named) {
    html += "<thead><tr>";
    for (std::size_t i = 0; i < table.header.size(); ++i) {
      html += fmt::format("<th scope=\"col\"{}>{}</th>", align(i), escapeHtml(table.header[i]));
    }
    html += "</tr></thead>\n";
  }
  html += "<tbody>\n";
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    const auto& row = table.rows[r];
    const bool bad = std::find(table.bad.begin(), table.bad.end(), r) != table.bad.end();
    html += bad ? "<tr class=\"bad\">" : "<tr>";
    for (std::size_t i = 0; i < row.size(); ++i) {
      const std::string_view cell = i == 0 ? "<th scope=\"row\"{}>{}</th>" : "<td{}>{}</td>";
      html += fmt::format(fmt::runtime(cell), align(i), escapeHtml(row[i]));
    }
    html += "</tr>\n";
  }
  html += "</tbody></table></div>\n";
  if (!table.note.empty()) html += fmt::format("<p class=\"note\">{}</p>\n", escapeHtml(table.note));
  html += "</figure>\n";
}

std::string base64(const std::vector<unsigned char>& bytes) {
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = bytes.size() - i;
    const unsigned group = bytes[i] * 65536U + (left > 1 ? bytes[i + 1] * 256U : 0U) +
                           (left > 2 ? static_cast<unsigned>(bytes[i + 2]) : 0U);
    out += kDigits[group >> 18U];
    out += kDigits[(group >> 12U) & 63U];
    out += left > 1 ? kDigits[(group >> 6U) & 63U] : '=';
    out += left > 2 ? kDigits[group & 63U] : '=';
  }
  return out;
}

void appendImages(std::string& html, const Report& report) {
  html += "<section class=\"card images\" aria-label=\"Pictures\">\n<div class=\"strip\">\n";
  for (const Image& image : report.images) {
    html +=
        fmt::format("<figure><img alt=\"{}\" src=\"data:image/png;base64,{}\"><figcaption>{}</figcaption></figure>\n",
                    escapeHtml(image.alt), base64(image.png), escapeHtml(image.title));
  }
  html += "</div>\n";
  if (!report.images_note.empty()) html += fmt::format("<p class=\"note\">{}</p>\n", escapeHtml(report.images_note));
  html += "</section>\n";
}

void requireConsistent(const Plot& plot) {
  for (const Series& series : plot.series) {
    if (series.values.size() == plot.x.size()) continue;
    throw std::logic_error("plot '" + plot.title + "': series '" + series.name + "' and x differ in length");
  }
}

/// The plot's data: {labels, styles, rows: [[x, y1, y2, ...], ...]}.
std::string plotJson(const Plot& plot) {
  requireConsistent(plot);
  std::vector<const std::vector<double>*> values;
  for (const Series& series : plot.series) values.push_back(&series.values);
  std::vector<std::string> styles, rows;
  for (const Series& s : plot.series) {
    styles.push_back(fmt::format(R"({{"name":{},"color":{},"dashed":{},"steps":{}}})", jsonString(s.name),
                                 jsonString(s.color), s.dashed, s.steps));
  }
  for (const std::size_t i : decimate(plot.x.size(), values, kMaxPlotRows)) {
    std::vector<std::string> row{jsonNumber(plot.x[i])};
    for (const auto* series : values) row.push_back(jsonNumber((*series)[i]));
    rows.push_back(fmt::format("[{}]", fmt::join(row, ",")));
  }
  const auto [low, high] = plot.y_range;
  const std::string range = low < high ? fmt::format("[{},{}]", jsonNumber(low), jsonNumber(high)) : "null";
  return fmt::format(R"({{"group":{},"xLabel":{},"yLabel":{},"yRange":{},"series":[{}],"rows":[{}]}})",
                     jsonString(plot.group), jsonString(plot.x_label), jsonString(plot.y_label), range,
                     fmt::join(styles, ","), fmt::join(rows, ","));
}

void appendPlot(std::string& html, const Plot& plot, std::size_t index) {
  std::vector<std::string> names;
  for (const Series& series : plot.series) names.push_back(series.name);
  const std::string title = escapeHtml(plot.title), y_label = escapeHtml(plot.y_label);
  const std::string description = fmt::format("{}: {} over {}; {}", title, y_label, escapeHtml(plot.x_label),
                                              escapeHtml(fmt::format("{}", fmt::join(names, ", "))));
  html += fmt::format("<figure class=\"card plot{}\" id=\"plot-{}\">\n<figcaption><h2>{}</h2>",
                      plot.half_width ? " half" : "", index, title);
  if (!plot.note.empty()) html += fmt::format("<p class=\"note\">{}</p>", escapeHtml(plot.note));
  html += fmt::format(
      "</figcaption>\n<div class=\"legend\" role=\"group\" aria-label=\"Lines of {}\"></div>\n"
      "<p class=\"y-label\">{}</p>\n<div class=\"canvas\" role=\"img\" aria-label=\"{}\"{}></div>\n",
      title, y_label, description,
      plot.height > 0.0 ? fmt::format(" style=\"height:{}px\"", jsonNumber(plot.height)) : std::string());
  html += fmt::format("<script type=\"application/json\">{}</script>\n</figure>\n", plotJson(plot));
}

void appendHead(std::string& html, const Report& report) {
  html += fmt::format(
      "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<meta name=\"color-scheme\" content=\"light dark\">\n<title>{}</title>\n<style>\n",
      escapeHtml(report.title));
  html += withoutSourceMap(assets::dygraphCss());
  html += assets::reportCss();
  html += "</style>\n</head>\n<body>\n<main>\n";
}

void appendScripts(std::string& html) {
  html += "<!-- The plots are drawn by Dygraphs:\n";
  html += assets::dygraphLicense();
  html += "-->\n<script>\n";
  html += withoutSourceMap(assets::dygraphJs());
  html += "</script>\n<script>\n";
  html += assets::reportJs();
  html += "</script>\n";
}

}  // namespace

std::string reportHtml(const Report& report) {
  std::string html;
  appendHead(html, report);
  html +=
      fmt::format("<header><h1>{}</h1>\n<p>{}</p></header>\n", escapeHtml(report.title), escapeHtml(report.subtitle));
  html += "<section class=\"tables\" aria-label=\"Figures\">\n";
  for (const Table& table : report.tables) appendTable(html, table);
  html += "</section>\n";
  if (!report.images.empty()) appendImages(html, report);
  if (!report.plots.empty()) {
    html +=
        "<p class=\"hint\">Drag across a plot to zoom, double-click to see all of it, hold Shift and drag to move; a "
        "line's name hides or shows it.</p>\n<noscript><p>The plots need JavaScript; the CSV files beside this page "
        "hold the same data.</p></noscript>\n";
  }
  html += "<section class=\"plots\" aria-label=\"Plots\">\n";
  for (std::size_t i = 0; i < report.plots.size(); ++i) appendPlot(html, report.plots[i], i);
  html += "</section>\n";
  if (!report.footer.empty()) html += fmt::format("<footer>{}</footer>\n", escapeHtml(report.footer));
  html += "</main>\n";
  if (!report.plots.empty()) appendScripts(html);
  return html + "</body>\n</html>\n";
}

void writeReport(const std::filesystem::path& path, const Report& report) { writeWhole(path, reportHtml(report)); }

}  // namespace palpate
