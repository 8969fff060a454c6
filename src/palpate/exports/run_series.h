#pragma once

#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "palpate/exports/recorded_run.h"
#include "palpate/mesh/types.h"
#include "palpate/mesh/vtu_file.h"

namespace palpate {

/// The bodies' tetrahedra at a time, or as built: at the nodes `displacement` [m], `von_mises` [Pa] and `contact_force`
/// [N] as recorded; in the tetrahedra `body`, `stress` [Pa] (xx yy zz xy yz xz: that of the corotational law, turned
/// with the element) and `von_mises` of it.
/// @param which  bodies; rigid ones have no tetrahedra of their own and are left out
/// @param frame  null: as built
VtuGrid meshGrid(const RecordedRun& run, const std::vector<std::size_t>& which, const RecordedFrame* frame);

/// The bodies' surfaces at a time, or as built [m].
Surface surfaceAt(const RecordedRun& run, const std::vector<std::size_t>& which, const RecordedFrame* frame);

/// What of a run becomes a time series.
struct SeriesOptions {
  bool mesh = true, surface = true, contacts = true;
  double from = 0, to = std::numeric_limits<double>::infinity();  ///< [s]
  int every = 1;                                                  ///< of so many steps one
  std::vector<std::size_t> bodies;                                ///< empty: all
};

/// Says how far it is.
using SeriesProgress = std::function<void(double share)>;

/// Writes mesh.pvd, surface.pvd and contacts.pvd with their VTU files (docs/files.md), all or none.
/// @returns how many steps were written
/// @throws InputError if the folder cannot be written, or there is no step between `from` and `to`
std::size_t writeSeries(RecordedRun& run, const SeriesOptions& options, const std::filesystem::path& folder,
                        const SeriesProgress& progress = {});

}  // namespace palpate
