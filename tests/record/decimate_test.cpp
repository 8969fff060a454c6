#include "palpate/record/decimate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace palpate {
namespace {

using Columns = std::vector<const std::vector<double>*>;

TEST(Decimate, ShortSeriesStayWhole) {
  const std::vector<double> values{3, 1, 2};
  EXPECT_EQ(decimate(3, Columns{&values}, 4), (std::vector<std::size_t>{0, 1, 2}));
}

TEST(Decimate, KeepsEndsExtremesAndLonePeaks) {
  std::vector<double> wave(20000), flat(20000, 1.0);
  for (std::size_t i = 0; i < wave.size(); ++i) wave[i] = std::sin(0.01 * static_cast<double>(i));
  flat[12345] = 9.0;
  flat[777] = -4.0;
  const auto rows = decimate(20000, Columns{&wave, &flat}, 4000);
  EXPECT_LE(rows.size(), 4002u);
  EXPECT_GE(rows.size(), 1000u);
  EXPECT_TRUE(std::is_sorted(rows.begin(), rows.end()));
  EXPECT_EQ(std::adjacent_find(rows.begin(), rows.end()), rows.end());
  EXPECT_EQ(rows.front(), 0u);
  EXPECT_EQ(rows.back(), 19999u);
  for (const std::size_t peak : {12345u, 777u}) EXPECT_TRUE(std::binary_search(rows.begin(), rows.end(), peak));
  const auto top = static_cast<std::size_t>(std::max_element(wave.begin(), wave.end()) - wave.begin());
  EXPECT_TRUE(std::binary_search(rows.begin(), rows.end(), top));
}

TEST(Decimate, KeepsGaps) {
  std::vector<double> values(10000, 1.0);
  values[5000] = std::numeric_limits<double>::quiet_NaN();
  const auto rows = decimate(values.size(), Columns{&values}, 100);
  EXPECT_TRUE(std::binary_search(rows.begin(), rows.end(), 5000u));
}

TEST(Decimate, ManySeriesAndFewRows) {
  const std::vector<std::vector<double>> data(50, std::vector<double>(1000, 2.0));
  Columns columns;
  for (const auto& column : data) columns.push_back(&column);
  const auto rows = decimate(1000, columns, 10);
  EXPECT_EQ(rows.front(), 0u);
  EXPECT_EQ(rows.back(), 999u);
}

}  // namespace
}  // namespace palpate
