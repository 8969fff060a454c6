#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace palpate {

/// One line of a plot.
struct Series {
  std::string name;
  std::vector<double> values;  ///< as many as the plot's x; values that are not finite are gaps
  std::string color{};  ///< empty: next of the palette; "1" to "8": that of the palette; "ink": foreground; "muted"; or
                        ///< a CSS color
  bool dashed = false;
  bool steps = false;  ///< holds each value until the next x
};

/// Lines over a common x axis.
struct Plot {
  std::string title;
  std::string y_label;    ///< with its unit, e.g. "Force, N"
  std::vector<double> x;  ///< increasing
  std::vector<Series> series;
  std::string note{};   ///< a sentence below the title: what to look for
  std::string group{};  ///< plots of the same group (empty: none) zoom and point together
  std::string x_label = "Time, s";
  bool half_width = false;                      ///< two of them stand side by side where there is room
  std::pair<double, double> y_range{0.0, 0.0};  ///< fixed range; equal ends: fitted to the values
  double height = 0.0;                          ///< [px]; 0: the usual height
};

struct Table {
  std::string title;
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows;  ///< cells that look like numbers are set right-aligned
  std::string note{};
  std::vector<std::size_t> bad{};  ///< rows that are set in red
};

/// A picture.
struct Image {
  std::string title;  ///< below it
  std::string alt;    ///< what it shows, for those who do not see it
  std::vector<unsigned char> png{};
};

/// A page that a person reads after a run.
struct Report {
  std::string title;
  std::string subtitle;
  std::vector<Table> tables;
  std::vector<Plot> plots;
  std::string footer{};
  std::vector<Image> images{};  ///< side by side above the plots
  std::string images_note{};    ///< a sentence below them
};

/// Rows of a plot that are kept; longer ones are thinned so that minima and maxima stay (see decimate.h).
inline constexpr std::size_t kMaxPlotRows = 4000;

/// The report as a self-contained HTML page (no network, light and dark, plots with zoom and values under the pointer).
/// @throws std::logic_error if a series and its x differ in length
std::string reportHtml(const Report& report);

/// Writes the page so that it appears whole or not at all; throws as writeWhole() of json_file.h.
void writeReport(const std::filesystem::path& path, const Report& report);

}  // namespace palpate
