#include <fmt/format.h>

#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "command_line.h"
#include "commands.h"
#include "palpate/common/error.h"
#include "palpate/exports/run_series.h"
#include "palpate/mesh/surface_io.h"
#include "palpate/mesh/text_scanner.h"
#include "progress.h"

namespace palpate {
namespace {

struct ExportOptions {
  std::string run, out, surface, mesh, body;
  std::vector<std::string> parts;
  std::optional<double> time;
  SeriesOptions series;
  std::vector<std::string> of_series;  ///< options given that only a series takes
};

// Before anything is read.
void checkOptions(ExportOptions& options) {
  const bool single = !options.surface.empty() || !options.mesh.empty();
  if (options.time && !single)
    throw InputError("--time", "", "needs --surface or --mesh; a series takes --from and --to");
  if (single && !options.of_series.empty())
    throw InputError(options.of_series.front(), "", "is for a series, without --surface and --mesh");
  if (!options.mesh.empty() && endingOf(options.mesh) != ".vtu")
    throw InputError("--mesh", "", "the name of the simulation mesh must end in .vtu");
  if (!options.surface.empty() && !canWriteSurface(options.surface))
    throw InputError("--surface", "", "the name of the surface must end in .obj, .ply, .stl or .off");
  if (options.parts.empty()) return;
  options.series.mesh = options.series.surface = options.series.contacts = false;
  for (const std::string& part : options.parts) {
    if (part == "mesh") {
      options.series.mesh = true;
    } else if (part == "surface") {
      options.series.surface = true;
    } else if (part == "contacts") {
      options.series.contacts = true;
    } else {
      throw InputError("--parts", "", "must be of mesh, surface and contacts, not '" + part + "'");
    }
  }
}

void exportSeries(const ExportOptions& options, RecordedRun& run) {
  const std::filesystem::path run_path = options.run;
  std::error_code ignored;
  const auto beside = std::filesystem::is_directory(run_path, ignored) ? run_path : run_path.parent_path();
  const std::filesystem::path folder = options.out.empty() ? beside / "vtu" : std::filesystem::path(options.out);
  std::optional<Progress> progress;  // only once something is written
  const std::size_t steps = writeSeries(run, options.series, folder, [&](double share) {
    if (!progress) progress.emplace("writing VTU files");
    (*progress)(share);
  });
  progress.reset();
  fmt::print("{} of {} steps, {:g} to {:g} s, in {}\n", steps, run.times().size(), run.times().front(),
             run.times().back(), folder.string());
}

void exportRun(ExportOptions options) {
  checkOptions(options);
  RecordedRun run = RecordedRun::open(options.run);
  if (!run.complaint().empty()) fmt::print(stderr, "note: the recording is incomplete: {}\n", run.complaint());
  if (!run.hasMaterials())
    fmt::print(stderr,
               "note: the recording is of an earlier version: without stress tensors, nor contact forces at nodes\n");
  std::vector<std::size_t> which(run.bodies().size());
  std::iota(which.begin(), which.end(), std::size_t{0});
  if (!options.body.empty()) which = {run.bodyNamed(options.body)};
  options.series.bodies = which;
  if (options.surface.empty() && options.mesh.empty()) return exportSeries(options, run);
  std::optional<RecordedFrame> frame;
  if (options.time) frame = run.at(*options.time);
  if (options.time && *options.time < run.times().front())
    fmt::print(stderr, "note: nothing was recorded before {:g} s, the end of the first step: it is taken\n",
               run.times().front());
  const RecordedFrame* at = frame ? &*frame : nullptr;
  if (!options.surface.empty()) {
    writeSurface(options.surface, surfaceAt(run, which, at));
    fmt::print("{}\n", options.surface);
  }
  if (!options.mesh.empty()) {
    const VtuGrid grid = meshGrid(run, which, at);
    if (grid.corners.empty()) throw InputError("--mesh", "", "a rigid body has no tetrahedra");
    writeFile(options.mesh, vtuBytes(grid));
    fmt::print("{}\n", options.mesh);
  }
}

}  // namespace

void addExportCommand(CLI::App& app) {
  const auto options = std::make_shared<ExportOptions>();
  CLI::App* command = app.add_subcommand(
      "export", "Write a recorded run for other programs: a time series for ParaView, or a surface or mesh at a time");
  command->add_option("run", options->run, "Folder of the run, or its recording.palpate")->required()->type_name("RUN");
  command
      ->add_option("--out", options->out, "Folder for the time series, VTU files with PVD files; default RUN/vtu")

      ->type_name("DIR");
  command->add_option("--parts", options->parts, "Of the series: mesh, surface, contacts; default: all")
      ->check(offers({"mesh", "surface", "contacts"}))
      ->delimiter(',')
      ->type_name("PART,...");
  command->add_option("--from", options->series.from, "First time of the series, s")->type_name("T");
  command->add_option("--to", options->series.to, "Last time of the series, s")->type_name("T");
  command->add_option("--every", options->series.every, "Of so many steps one")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str()
      ->type_name("N");
  command
      ->add_option("--surface", options->surface, "Write the surface instead: .obj, .ply, .stl or .off")

      ->type_name("FILE");
  command
      ->add_option("--mesh", options->mesh, "Write the simulation mesh instead: .vtu")

      ->type_name("FILE");
  command->add_option("--time", options->time, "Time of surface and mesh, s; default: as built")->type_name("T");
  command->add_option("--body", options->body, "Of this body only")->type_name("NAME");
  command->callback([options, command] {
    for (const char* name : {"--parts", "--from", "--to", "--every", "--out"})
      if (command->count(name) > 0) options->of_series.emplace_back(name);
    exportRun(*options);
  });
}

}  // namespace palpate
