#include "palpate/record/report.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace palpate {
namespace {

/// The JSON of the first plot.
nlohmann::json plotData(const std::string& page) {
  const std::string open = "<script type=\"application/json\">";
  const auto begin = page.find(open) + open.size();
  return nlohmann::json::parse(page.substr(begin, page.find("</script>", begin) - begin));
}

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t n = 0;
  for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++n;
  return n;
}

Report smallReport() {
  Report report;
  report.title = "A & B <run>";
  report.tables = {{"Figures", {"Name", "Value, N"}, {{"peak", "8.73"}, {"drag", "-"}}}};
  Plot plot;
  plot.title = "Force </script> \"quoted\"";
  plot.y_label = "Force, N";
  plot.x = {0.0, 0.001, 0.002};
  plot.series = {{"raw", {1.0, std::numeric_limits<double>::quiet_NaN(), -2.5}},
                 {"</script><b>", {0.0, 1e-7, 123456.7}, "ink", true, true}};
  plot.group = "time";
  report.plots = {plot};
  return report;
}

TEST(Report, CarriesItsDataExactly) {
  const auto data = plotData(reportHtml(smallReport()));
  EXPECT_EQ(data.at("group"), "time");
  EXPECT_EQ(data.at("yLabel"), "Force, N");
  EXPECT_TRUE(data.at("yRange").is_null());
  EXPECT_EQ(data.at("series")[1],
            (nlohmann::json{{"name", "</script><b>"}, {"color", "ink"}, {"dashed", true}, {"steps", true}}));
  EXPECT_EQ(data.at("rows"), (nlohmann::json::parse("[[0,1,0],[0.001,null,1e-7],[0.002,-2.5,123456.7]]")));
}

TEST(Report, EscapesTextFromOutside) {
  const std::string page = reportHtml(smallReport());
  EXPECT_NE(page.find("<title>A &amp; B &lt;run&gt;</title>"), std::string::npos);
  EXPECT_EQ(page.find("Force </script>"), std::string::npos);
  EXPECT_EQ(count(page, "<script"), count(page, "</script>"));
}

TEST(Report, NeedsNoNetwork) {
  const std::string page = reportHtml(smallReport());
  EXPECT_NE(page.find("Dygraph"), std::string::npos);
  for (const char* reference : {"<link", " src=", "@import", "url(", "sourceMappingURL"}) {
    EXPECT_EQ(page.find(reference), std::string::npos) << reference;
  }
  EXPECT_NE(page.find("Permission is hereby granted"), std::string::npos);
}

TEST(Report, NumbersInTablesAreRightAligned) {
  const std::string page = reportHtml(smallReport());
  EXPECT_NE(page.find("<th scope=\"col\" class=\"number\">Value, N</th>"), std::string::npos);
  EXPECT_NE(page.find("<th scope=\"col\">Name</th>"), std::string::npos);
  EXPECT_NE(page.find("<td class=\"number\">8.73</td>"), std::string::npos);
}

TEST(Report, LongSeriesAreThinnedButKeepTheirPeaks) {
  Report report = smallReport();
  Plot& plot = report.plots[0];
  plot.x.assign(20000, 0.0);
  for (std::size_t i = 0; i < plot.x.size(); ++i) plot.x[i] = 0.001 * static_cast<double>(i);
  for (Series& series : plot.series) series.values.assign(plot.x.size(), 0.5);
  plot.series[0].values[4321] = 77.0;
  const auto rows = plotData(reportHtml(report)).at("rows");
  EXPECT_LE(rows.size(), kMaxPlotRows + 2);
  EXPECT_TRUE(std::any_of(rows.begin(), rows.end(), [](const auto& row) { return row[0] == 4.321 && row[1] == 77; }));
}

TEST(Report, SeriesOfTheWrongLengthAreMistakes) {
  Report report = smallReport();
  report.plots[0].series[0].values.pop_back();
  EXPECT_THROW(reportHtml(report), std::logic_error);
}

TEST(Report, WithoutPlotsThereIsNoScript) {
  Report report = smallReport();
  report.plots.clear();
  EXPECT_EQ(reportHtml(report).find("<script"), std::string::npos);
}

TEST(Report, CarriesPicturesInsideItself) {
  Report report = smallReport();
  EXPECT_EQ(reportHtml(report).find("<img"), std::string::npos);
  const std::string text = "any carnal pleasure.";  // RFC 4648's alphabet, with each length of the rest
  const std::vector<std::string> digits{
      "YW55IGNhcm5hbCBwbGVhc3VyZS4=", "YW55IGNhcm5hbCBwbGVhc3VyZQ==", "YW55IGNhcm5hbCBwbGVhc3Vy"};
  for (std::size_t cut = 0; cut < 3; ++cut) {
    report.images.push_back({"a < b", "\"quoted\"", {text.begin(), text.end() - static_cast<std::ptrdiff_t>(cut)}});
  }
  report.images.push_back({"bits", "bits", {0xff, 0xef, 0xbe}});
  const std::string page = reportHtml(report);
  for (const std::string& d : digits) EXPECT_EQ(count(page, "src=\"data:image/png;base64," + d + "\">"), 1U) << d;
  EXPECT_EQ(count(page, "base64,/+++\">"), 1U);
  EXPECT_EQ(count(page, "<figcaption>a &lt; b</figcaption>"), 3U);
  EXPECT_EQ(count(page, "alt=\"&quot;quoted&quot;\""), 3U);
}

}  // namespace
}  // namespace palpate
