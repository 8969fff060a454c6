#include "command_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <memory>

#include "command_line.h"
#include "commands.h"
#include "palpate/common/error.h"
#include "palpate/mesh/alien.h"
#include "palpate/mesh/shapes.h"
#include "palpate/mesh/surface_io.h"
#include "palpate/mesh/tetrahedral_io.h"
#include "palpate/mesh/text_scanner.h"
#include "palpate/threads/stage_teller.h"

namespace palpate {
namespace {

/// One line of a report: a name in a column, then what is said of it.
template <typename... Values>
void line(std::string& out, const char* name, fmt::format_string<Values...> format, Values&&... values) {
  out += fmt::format("{:<22}{}\n", name, fmt::format(format, std::forward<Values>(values)...));
}

void formatRepair(std::string& out, const RepairReport& r) {
  line(out, "repaired", "{} vertices welded, {} triangles turned, {} duplicate and {} degenerate dropped",
       r.welded_vertices, r.flipped_triangles, r.duplicate_triangles, r.degenerate_triangles);
  line(out, "left open", "{} holes ({} boundary edges), {} non-manifold edges", r.topology.holes,
       r.topology.boundary_edges, r.topology.nonmanifold_edges);
}

void requireLength(const char* option, double length) {
  if (!(length >= 0) || !std::isfinite(length)) throw InputError(option, "", "must be a finite length, m");
}

bool isVolumeFile(const std::string& path) { return endingOf(path) == ".vtk" || endingOf(path) == ".vtu"; }

constexpr int kMostTetrahedra = 200'000;

void requireCount(int tetrahedra, int least, const char* cause) {
  if (tetrahedra < least || tetrahedra > kMostTetrahedra) throw InputError("--tets", "", cause);
}

}  // namespace

EmbedSummary runMeshEmbed(const EmbedCommand& command) {
  if (!command.out.empty() && !isVolumeFile(command.out))
    throw InputError("--out", "", "the name of a simulation mesh must end in .vtu or .vtk");
  requireCount(command.tetrahedra, 0, "must be from 1 to 200000, or auto");
  requireLength("--size", command.size);
  if (command.tolerance) requireLength("--tolerance", *command.tolerance);
  StageTeller teller;
  teller.at(command.surface + ": making its mesh");
  RepairReport repair;
  const Surface solid = loadSolid(command.surface, command.size, &repair);
  EmbedOptions options;
  options.target_tetrahedra = command.tetrahedra;
  options.name = command.surface;
  options.surface_tolerance = command.tolerance;
  EmbedSummary summary;
  const SimulationMesh mesh = embedSurface(solid, options, &summary.embed);
  // The repair that matters to the user is that of the file.
  summary.embed.repair = repair;
  summary.surface = command.surface;
  summary.surface_vertices = static_cast<int>(mesh.surface.vertices.size());
  summary.surface_triangles = static_cast<int>(mesh.surface.triangles.size());
  if (!command.out.empty()) writeSimulationMesh(command.out, mesh);
  return summary;
}

std::string formatReport(const EmbedSummary& s) {
  const EmbedReport& r = s.embed;
  std::string out;
  line(out, "surface", "{} triangles, {} vertices", s.surface_triangles, s.surface_vertices);
  formatRepair(out, r.repair);
  if (r.surface_deviation > 0) {
    line(out, "simplified", "from {} triangles, at most {:.2g} m away (--tolerance 0 keeps them)", r.given_triangles,
         r.surface_deviation);
  }
  line(out, "volume", "{:.6g} m^3 (mesh {:.6g} m^3, as sampled {:+.2f} %)", r.surface_volume, r.mesh_volume,
       100 * (r.sampled_volume / r.surface_volume - 1));
  line(out, "tetrahedra", "{}, {} nodes, cell {:.4g} m", r.tetrahedra, r.nodes, r.cell_size);
  line(out, "pieces", "{} (surface {}), each connected through faces; {} lattice tetrahedra with several copies",
       r.components, r.solid_components, r.split_tetrahedra);
  if (r.bridges > 0)
    line(out, "bridged", "{} places thinner than a sample of {:.2g} m", r.bridges, r.cell_size / r.subdivision);
  if (r.seams > 0)
    line(out, "SEAMS", "{} places where the surface may open under load: ask for more tetrahedra", r.seams);
  if (r.overlap_share > 0)
    line(out, "overlap", "{:.1f} % of the volume lies in several of the solids and is counted once",
         100 * r.overlap_share / (1 + r.overlap_share));
  line(out, "thickness", "a twentieth of the surface has less than {:.3g} m of solid under it", r.thickness);
  if (r.thin_share > 0.05) {
    line(out, "TOO THIN",
         "{:.0f} % of the surface has less than a cell under it and is too stiff; --tets {} carries it",
         100 * r.thin_share, r.suggested_tetrahedra);
  }
  line(out, "worst element", "its node has {:.3f} of the median node's stiffness; least fill {:.3f}", r.softest_node,
       r.smallest_fill);
  line(out, "vertices outside", "{} of {}, smallest weight {:.3f}", r.vertices_outside, s.surface_vertices,
       r.smallest_weight);
  line(out, "time", "{:.2f} s", r.seconds);
  return out;
}

StiffnessSummary runMeshStiffness(const StiffnessCommand& command) {
  requireLength("--size", command.size);
  if (command.tetrahedra.empty()) throw InputError("--tets", "", "names no count");
  for (const int count : command.tetrahedra) requireCount(count, 1, "must be from 1 to 200000");
  StageTeller teller;
  teller.at(command.surface + ": reading");
  const Surface solid = loadSolid(command.surface, command.size);
  StiffnessSummary summary{command.surface, {}};
  std::vector<int> counts = command.tetrahedra;
  std::sort(counts.begin(), counts.end());
  for (const int count : counts) {
    EmbedOptions options;
    options.target_tetrahedra = count;
    options.name = command.surface;
    fmt::print(stderr, "{} tetrahedra\n", count);
    teller.at(fmt::format("{} tetrahedra: mesh and stiffness", count));
    summary.meshes.push_back(meshStiffness(solid, options));
  }
  return summary;
}

std::string formatReport(const StiffnessSummary& s) {
  const Vec3 finest = s.meshes.back().stiffness;
  std::string out = "Force by displacement of the pulled end at 1 kPa, N/m, and times that of the finest mesh\n";
  out += fmt::format("{:>10} {:>10} {:>18} {:>18} {:>18}\n", "tetrahedra", "cell, m", "along x", "along y", "along z");
  for (const MeshStiffness& m : s.meshes) {
    out += fmt::format("{:>10} {:>10.3g}", m.embed.tetrahedra, m.embed.cell_size);
    for (int d = 0; d < 3; ++d)
      out += fmt::format(" {:>18}", fmt::format("{:.3g} ({:.2f})", m.stiffness[d], m.stiffness[d] / finest[d]));
    out += '\n';
  }
  return out;
}

InfoSummary runMeshInfo(const std::string& path) {
  const Surface raw = readSurface(path);
  const RepairedSurface repaired = repairSurface(raw);
  InfoSummary s;
  s.surface = path;
  s.file_vertices = static_cast<int>(raw.vertices.size());
  s.file_triangles = static_cast<int>(raw.triangles.size());
  s.repair = repaired.report;
  s.measures = measureSolid(repaired.surface);
  s.quality = measureQuality(repaired.surface);
  s.bounds = boundsOf(repaired.surface.vertices);
  return s;
}

namespace {

void formatExtents(std::string& out, const Bounds& bounds) {
  const Vec3 extent = bounds.high - bounds.low;
  line(out, "size", "{:.6g} x {:.6g} x {:.6g}", extent.x(), extent.y(), extent.z());
  line(out, "extents", "({:.6g}, {:.6g}, {:.6g}) to ({:.6g}, {:.6g}, {:.6g})", bounds.low.x(), bounds.low.y(),
       bounds.low.z(), bounds.high.x(), bounds.high.y(), bounds.high.z());
}

// By its name: files that cannot be read are refused as such.
bool isTetrahedral(const std::string& path) {
  const std::string ending = endingOf(path);
  return isVolumeFile(path) || ending == ".msh" || ending == ".node" || ending == ".ele" || ending == ".med" ||
         ending == ".pvtu";
}

}  // namespace

TetrahedraInfo runTetrahedraInfo(const std::string& path) {
  TetrahedraInfo info;
  const SimulationMesh mesh = simulationMeshOf(readTetrahedra(path, &info.notes), path);
  info.mesh = path;
  info.tetrahedra = static_cast<int>(mesh.mesh.tetrahedra.size());
  info.nodes = static_cast<int>(mesh.mesh.nodes.size());
  info.surface_nodes = static_cast<int>(mesh.surface.vertices.size());
  info.surface_triangles = static_cast<int>(mesh.surface.triangles.size());
  for (const auto& t : mesh.mesh.tetrahedra) info.volume += tetrahedronVolume(mesh.mesh, t);
  info.quality = measureQuality(mesh.mesh);
  info.bounds = boundsOf(mesh.mesh.nodes);
  return info;
}

std::string formatReport(const TetrahedraInfo& s) {
  std::string out;
  line(out, "tetrahedra", "{}, {} pieces ({} connected through faces)", s.tetrahedra, s.quality.components,
       s.quality.face_components);
  line(out, "nodes", "{}, {} on the surface of {} triangles", s.nodes, s.surface_nodes, s.surface_triangles);
  for (const std::string& note : s.notes) line(out, "note", "{}", note);
  formatExtents(out, s.bounds);
  line(out, "volume", "{:.6g}", s.volume);
  line(out, "worst elements", "dihedral angles {:.1f} to {:.1f} degrees, radius ratio {:.3g}, volume {:.3g}",
       s.quality.smallest_dihedral_deg, s.quality.largest_dihedral_deg, s.quality.worst_radius_ratio,
       s.quality.smallest_volume);
  return out;
}

std::string formatReport(const InfoSummary& s) {
  std::string out;
  line(out, "file", "{} triangles, {} vertices", s.file_triangles, s.file_vertices);
  formatRepair(out, s.repair);
  line(out, "closed", "{}, {} pieces, Euler characteristic {}", s.repair.topology.closed() ? "yes" : "no",
       s.repair.topology.components, s.repair.topology.euler);
  formatExtents(out, s.bounds);
  line(out, "volume", "{:.6g} (holes closed), area {:.6g}", s.measures.volume, s.measures.area);
  const Vec3& c = s.measures.center_of_mass;
  line(out, "center of mass", "{:.6g} {:.6g} {:.6g}", c.x(), c.y(), c.z());
  line(out, "triangles", "angles {:.1f} to {:.1f} degrees, edges {:.4g} to {:.4g}", s.quality.smallest_angle_deg,
       s.quality.largest_angle_deg, s.quality.shortest_edge, s.quality.longest_edge);
  return out;
}

namespace {

Surface makeShape(const MakeCommand& c) {
  const double size = c.size > 0 ? c.size : 0.1;
  if (c.shape == "alien") return makeAlien(c.size > 0 ? AlienOptions{c.size} : AlienOptions{}).surface;
  if (c.shape == "box") return boxSurface(Vec3::Constant(size), {8, 8, 8});
  if (c.shape == "sphere") return sphereSurface(size / 2, 5);
  if (c.shape == "capsule") return capsuleSurface(size / 8, 0.75 * size, 48);
  throw InputError("mesh make", "shape", "must be alien, bar, box, sphere or capsule, not '" + c.shape + "'");
}

// By its name; other kinds of file are only read.
void requireWritable(const MakeCommand& c) {
  if (canWriteSurface(c.out)) return;
  if (c.shape != "bar")
    throw InputError("--out", "", "the name of a surface must end in .obj, .stl, .ply or .off, not '" + c.out + "'");
  if (!isVolumeFile(c.out))
    throw InputError("--out", "",
                     "the name of a bar must end in .obj, .stl, .ply, .off, .vtu or .vtk, not '" + c.out + "'");
}

}  // namespace

MakeSummary runMeshMake(const MakeCommand& command) {
  requireLength("--size", command.size);
  requireWritable(command);
  MakeSummary s{command.shape, command.out, 0, 0, 0};
  Surface surface;
  if (command.shape == "bar") {
    const double edge = command.size > 0 ? command.size : 0.08;
    const SimulationMesh bar = barMesh(edge * Vec3(1, 1, 0.75), command.cells);
    s.tetrahedra = static_cast<int>(bar.mesh.tetrahedra.size());
    surface = bar.surface;
    if (isVolumeFile(command.out)) writeSimulationMesh(command.out, bar);
  } else {
    surface = makeShape(command);
  }
  s.vertices = static_cast<int>(surface.vertices.size());
  s.triangles = static_cast<int>(surface.triangles.size());
  if (!isVolumeFile(command.out) || command.shape != "bar") writeSurface(command.out, surface);
  return s;
}

std::string formatReport(const MakeSummary& s) {
  std::string out;
  line(out, "surface", "{} triangles, {} vertices", s.triangles, s.vertices);
  if (s.tetrahedra > 0) line(out, "tetrahedra", "{}", s.tetrahedra);
  line(out, "written", "{}", s.out);
  return out;
}

namespace {

// 0: to be chosen
int countOf(const std::string& text) {
  if (text == "auto") return 0;
  int count = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), count);
  if (error != std::errc() || end != text.data() + text.size() || count < 1 || count > kMostTetrahedra)
    throw InputError("--tets", "", "must be from 1 to 200000, or auto, not '" + text + "'");
  return count;
}

void addSurface(CLI::App& command, std::string& surface) {
  command.add_option("surface", surface, "Triangle surface: OBJ, STL, PLY, OFF, glTF or 3MF")
      ->required()
      ->type_name("SURFACE");
}

// 0 stands for none given, so it is no size that one may give.
void addSize(CLI::App& command, double& size, const std::string& what) {
  const auto take = [&size](const double& given) {
    if (given == 0) throw InputError("--size", "", "must be more than 0 m");
    size = given;
  };
  command.add_option_function<double>("--size", take, what)->type_name("S");
}

constexpr const char* kSizeOfFile = "Longest side of the bounding box, m; default: lengths as in the file";

void addEmbed(CLI::App& group) {
  const auto options = std::make_shared<EmbedCommand>();
  CLI::App* command = group.add_subcommand("embed", "Make the simulation mesh of a surface, and say how good it is");
  addSurface(*command, options->surface);
  const auto take = [options](const std::string& text) { options->tetrahedra = countOf(text); };
  command->add_option_function<std::string>("--tets", take, "Wanted number of tetrahedra; auto: by the thinnest parts")
      ->type_name("N|auto")
      ->default_str("300");
  addSize(*command, options->size, kSizeOfFile);
  command
      ->add_option(
          "--tolerance", options->tolerance,
          "How far the embedded surface may be from the file's, to have fewer triangles, m; 0: all stay; default: "
          "1 % of a cell, at most 0.1 % of the diagonal")
      ->type_name("T");
  command
      ->add_option("--out", options->out, "Write the simulation mesh (.vtu or .vtk)")

      ->type_name("FILE");
  command->callback([options] { fmt::print("{}", formatReport(runMeshEmbed(*options))); });
}

void addStiffness(CLI::App& group) {
  const auto options = std::make_shared<StiffnessCommand>();
  CLI::App* command = group.add_subcommand(
      "stiffness",
      "How the stiffness of a surface's mesh depends on its number of tetrahedra: coarse ones are too stiff");
  addSurface(*command, options->surface);
  command->add_option("--tets", options->tetrahedra, "Numbers of tetrahedra")->type_name("N...")->capture_default_str();
  addSize(*command, options->size, kSizeOfFile);
  command->callback([options] { fmt::print("{}", formatReport(runMeshStiffness(*options))); });
}

void addInfo(CLI::App& group) {
  const auto file = std::make_shared<std::string>();
  CLI::App* command =
      group.add_subcommand("info", "Say what is in a file: a surface, before and after repair, or a tetrahedral mesh");
  command
      ->add_option("file", *file,
                   "Triangle surface: OBJ, STL, PLY, OFF, glTF or 3MF; tetrahedra: VTU, VTK, Gmsh or TetGen")
      ->required()
      ->type_name("FILE");
  command->callback([file] {
    fmt::print("{}", isTetrahedral(*file) ? formatReport(runTetrahedraInfo(*file)) : formatReport(runMeshInfo(*file)));
  });
}

void addMake(CLI::App& group) {
  const auto options = std::make_shared<MakeCommand>();
  CLI::App* command = group.add_subcommand("make", "Make a procedural shape");
  command->add_option("shape", options->shape, "alien, bar, box, sphere or capsule")
      ->required()
      ->check(offers({"alien", "bar", "box", "sphere", "capsule"}))
      ->type_name("SHAPE");
  command->add_option("--out", options->out, "File to write: .obj, .stl, .ply, .off; a bar also .vtu, .vtk")
      ->required()
      ->type_name("FILE");
  addSize(*command, options->size, "Height, length or diameter, m");
  CLI::Option* cells =
      command->add_option("--cells", options->cells, "Cells of a bar along x, y, z")->type_name("NX NY NZ");
  command->callback([options, cells] {
    if (cells->count() > 0 && options->shape != "bar") throw InputError("--cells", "", "is for a bar");
    fmt::print("{}", formatReport(runMeshMake(*options)));
  });
}

}  // namespace

void addMeshCommand(CLI::App& app) {
  CLI::App* group = app.add_subcommand("mesh", "Simulation meshes and shapes");
  group->require_subcommand(1);
  addEmbed(*group);
  addStiffness(*group);
  addInfo(*group);
  addMake(*group);
}

}  // namespace palpate
