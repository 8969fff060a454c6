#include <fmt/format.h>

#include <memory>

#include "commands.h"
#include "mesh_commands.h"

namespace palpate {
namespace {

void addEmbed(CLI::App& group) {
  const auto options = std::make_shared<EmbedCommand>();
  CLI::App* command = group.add_subcommand("embed", "Make the simulation mesh of a surface, and say how good it is");
  command->add_option("surface", options->surface, "Triangle surface: OBJ, STL, PLY or OFF")
      ->required()
      ->type_name("SURFACE");
  command->add_option("--tets", options->tetrahedra, "Wanted number of tetrahedra")
      ->type_name("N")
      ->capture_default_str();
  command->add_option("--size", options->size, "Longest side of the bounding box, m; default: lengths as in the file")
      ->type_name("S");
  command->add_option("--out", options->out, "Write the simulation mesh (.vtk)")->type_name("FILE");
  command->callback([options] { fmt::print("{}", formatReport(runMeshEmbed(*options))); });
}

void addInfo(CLI::App& group) {
  const auto surface = std::make_shared<std::string>();
  CLI::App* command = group.add_subcommand("info", "Say what is in a surface file, before and after repair");
  command->add_option("surface", *surface, "Triangle surface: OBJ, STL, PLY or OFF")->required()->type_name("SURFACE");
  command->callback([surface] { fmt::print("{}", formatReport(runMeshInfo(*surface))); });
}

void addMake(CLI::App& group) {
  const auto options = std::make_shared<MakeCommand>();
  CLI::App* command = group.add_subcommand("make", "Make a procedural shape");
  command->add_option("shape", options->shape, "alien, bar, box, sphere or capsule")->required()->type_name("SHAPE");
  command->add_option("--out", options->out, "File to write: .obj, .stl, .ply, .off; a bar also .vtk")
      ->required()
      ->type_name("FILE");
  command->add_option("--size", options->size, "Height, length or diameter, m")->type_name("S");
  command->add_option("--cells", options->cells, "Cells of a bar along x, y, z")->type_name("NX NY NZ");
  command->callback([options] { fmt::print("{}", formatReport(runMeshMake(*options))); });
}

}  // namespace

void addMeshCommand(CLI::App& app) {
  CLI::App* group = app.add_subcommand("mesh", "Simulation meshes and shapes");
  group->require_subcommand(1);
  addEmbed(*group);
  addInfo(*group);
  addMake(*group);
}

}  // namespace palpate
