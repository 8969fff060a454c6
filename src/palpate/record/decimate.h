#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace palpate {

/// Chooses rows of a table of series that keep what a plot shows: the first, the last, and in equal stretches of rows
/// the minimum and maximum of every series. Rows stay in order; all are chosen if there are at most `max_rows`.
/// @param rows      length of every series
/// @param max_rows  about how many rows to choose; at least two a series are taken
std::vector<std::size_t> decimate(std::size_t rows, std::span<const std::vector<double>* const> series,
                                  std::size_t max_rows);

}  // namespace palpate
