#include "palpate/exports/run_series.h"

#include <fmt/format.h>

#include <cmath>

#include "palpate/common/error.h"
#include "palpate/fem/polar.h"
#include "palpate/fem/stress.h"
#include "palpate/record/json_file.h"
#include "palpate/record/output_folder.h"

namespace palpate {
namespace {

Vec3 at(const std::vector<float>& values, std::size_t i) {
  return {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
}
void append(std::vector<float>& out, const Vec3& v) {
  for (int d = 0; d < 3; ++d) out.push_back(static_cast<float>(v[d]));
}
void appendPart(std::vector<float>& out, const std::vector<float>& values, std::size_t first, std::size_t count) {
  out.insert(out.end(), values.begin() + static_cast<std::ptrdiff_t>(first),
             values.begin() + static_cast<std::ptrdiff_t>(first + count));
}

// A body's nodes, as built or in a frame.
std::vector<float> nodesOf(const RecordedBody& body, const RecordedFrame* frame) {
  if (frame == nullptr) return body.rest;
  std::vector<float> out;
  appendPart(out, frame->nodes, 3 * body.first_node, 3 * body.nodes());
  return out;
}

// Stress of the corotational law in a tetrahedron, turned with it [Pa].
Mat3 stressOf(const RecordedBody& body, std::size_t t, const std::vector<float>& nodes, double stiffness) {
  Mat3 rest, now;
  const std::int32_t* corner = body.tetrahedra.data() + 4 * t;
  const auto origin = static_cast<std::size_t>(corner[0]);
  for (int k = 0; k < 3; ++k) {
    const auto node = static_cast<std::size_t>(corner[k + 1]);
    rest.col(k) = at(body.rest, node) - at(body.rest, origin);
    now.col(k) = at(nodes, node) - at(nodes, origin);
  }
  if (!(std::abs(rest.determinant()) > 0)) return Mat3::Zero();
  const Mat3 gradient = now * rest.inverse();
  const Mat3 rotation = polarRotation(gradient, Mat3::Identity());
  const Mat3 stress = stiffness * corotationalStress(rotation.transpose() * gradient, body.lambda[t], body.mu[t]);
  return rotation * stress * rotation.transpose();
}

// The arrays of a grid of tetrahedra, body after body.
struct MeshArrays {
  std::vector<float> points, displacement, von_mises, force, stress, cell_von_mises;
  std::vector<std::int32_t> corners, body;
};

void addStress(const RecordedBody& body, const std::vector<float>& nodes, double stiffness, MeshArrays& out) {
  for (std::size_t t = 0; t < body.lambda.size(); ++t) {
    const Mat3 s = stressOf(body, t, nodes, stiffness);
    for (const double v : {s(0, 0), s(1, 1), s(2, 2), s(0, 1), s(1, 2), s(0, 2)})
      out.stress.push_back(static_cast<float>(v));
    out.cell_von_mises.push_back(static_cast<float>(vonMises(s)));
  }
}

void addMesh(const RecordedRun& run, std::size_t b, const RecordedFrame* frame, MeshArrays& out) {
  const RecordedBody& body = run.bodies()[b];
  if (body.rigid) return;
  const auto first = static_cast<std::int32_t>(out.points.size() / 3);
  const std::vector<float> nodes = nodesOf(body, frame);
  out.points.insert(out.points.end(), nodes.begin(), nodes.end());
  for (std::size_t i = 0; i < body.nodes(); ++i) append(out.displacement, at(nodes, i) - at(body.rest, i));
  for (const std::int32_t corner : body.tetrahedra) out.corners.push_back(first + corner);
  out.body.insert(out.body.end(), body.tetrahedra.size() / 4, static_cast<std::int32_t>(b));
  if (frame != nullptr && !frame->von_mises.empty())
    appendPart(out.von_mises, frame->von_mises, body.first_node, body.nodes());
  if (frame != nullptr && !frame->forces.empty())
    appendPart(out.force, frame->forces, 3 * body.first_node, 3 * body.nodes());
  if (frame != nullptr && run.hasMaterials()) addStress(body, nodes, frame->stiffness[b], out);
}

// Vertices of a body's surface, for nodes of that many numbers each.
std::vector<float> onSurface(const RecordedBody& body, const std::vector<float>& at_nodes, std::size_t components) {
  const std::size_t vertices = body.vertex_nodes.size() / 4;
  std::vector<float> out(vertices * components);
  for (std::size_t v = 0; v < vertices; ++v) {
    for (std::size_t d = 0; d < components; ++d) {
      double sum = 0;
      for (std::size_t k = 4 * v; k < 4 * v + 4; ++k)
        sum +=
            double{body.vertex_weights[k]} * at_nodes[components * static_cast<std::size_t>(body.vertex_nodes[k]) + d];
      out[v * components + d] = static_cast<float>(sum);
    }
  }
  return out;
}

VtuGrid surfaceGrid(const RecordedBody& body, const RecordedFrame& frame) {
  const std::vector<float> nodes = nodesOf(body, &frame);
  std::vector<float> points = onSurface(body, nodes, 3);
  std::vector<float> displacement = points;
  const std::vector<float> rest = onSurface(body, body.rest, 3);
  for (std::size_t i = 0; i < rest.size(); ++i) displacement[i] -= rest[i];
  VtuGrid grid;
  grid.cell = VtuGrid::Cell::triangle;
  grid.corners = body.triangles;
  grid.points = {"Points", 3, std::move(points)};
  grid.point_data.push_back({"displacement", 3, std::move(displacement)});
  if (!frame.von_mises.empty() && !body.rigid) {
    std::vector<float> stress;
    appendPart(stress, frame.von_mises, body.first_node, body.nodes());
    stress = onSurface(body, stress, 1);
    for (float& s : stress) s = std::max(s, 0.0F);  // a vertex outside of its tetrahedron extrapolates
    grid.point_data.push_back({"von_mises", 1, std::move(stress)});
  }
  grid.time = frame.time;
  return grid;
}

VtuGrid contactGrid(const RecordedFrame& frame) {
  std::vector<float> points, normal, force;
  std::vector<std::int32_t> corners, state, body, other;
  for (const RecordedContact& c : frame.contacts) {
    corners.push_back(static_cast<std::int32_t>(corners.size()));
    points.insert(points.end(), c.position.begin(), c.position.end());
    normal.insert(normal.end(), c.normal.begin(), c.normal.end());
    force.insert(force.end(), c.force.begin(), c.force.end());
    state.push_back(c.state);
    body.push_back(c.body);
    other.push_back(c.other);
  }
  VtuGrid grid;
  grid.cell = VtuGrid::Cell::vertex;
  grid.corners = std::move(corners);
  grid.points = {"Points", 3, std::move(points)};
  grid.point_data = {{"force", 3, std::move(force)},
                     {"normal", 3, std::move(normal)},
                     {"state", 1, std::move(state)},
                     {"body", 1, std::move(body)},
                     {"other", 1, std::move(other)}};
  grid.time = frame.time;
  return grid;
}

std::string fileName(const std::string& name) {
  std::string out;
  for (const char c : name) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
    out += plain ? c : '_';
  }
  return out;
}

// Files of a step for each of the three series.
class SeriesWriter {
 public:
  SeriesWriter(const RecordedRun& run, const SeriesOptions& options, const std::filesystem::path& folder)
      : run_(run), options_(options), folder_(folder) {}

  void add(const RecordedFrame& frame, std::size_t step) {
    for (const std::size_t b : options_.bodies) {
      const RecordedBody& body = run_.bodies()[b];
      if (options_.mesh && !body.rigid) put("mesh", b, step, frame.time, meshGrid(run_, {b}, &frame), mesh_);
      if (options_.surface) put("surface", b, step, frame.time, surfaceGrid(body, frame), surface_);
    }
    if (!options_.contacts) return;
    const std::string file = fmt::format("contacts-{:05}.vtu", step);
    writeWhole(folder_.stage(file), vtuBytes(contactGrid(frame)));
    contacts_.push_back({frame.time, 0, "contacts", file});
  }
  void finish() {
    if (!mesh_.empty()) writeWhole(folder_.stage("mesh.pvd"), pvdText(mesh_));
    if (!surface_.empty()) writeWhole(folder_.stage("surface.pvd"), pvdText(surface_));
    if (!contacts_.empty()) writeWhole(folder_.stage("contacts.pvd"), pvdText(contacts_));
    folder_.commit();
  }

 private:
  void put(const char* kind, std::size_t b, std::size_t step, double time, const VtuGrid& grid,
           std::vector<PvdEntry>& entries) {
    const std::string& name = run_.bodies()[b].name;
    const std::string file = fmt::format("{}-{}-{}-{:05}.vtu", kind, b, fileName(name), step);
    writeWhole(folder_.stage(file), vtuBytes(grid));
    entries.push_back({time, static_cast<int>(b), name, file});
  }

  const RecordedRun& run_;
  const SeriesOptions& options_;
  OutputFolder folder_;
  std::vector<PvdEntry> mesh_, surface_, contacts_;
};

}  // namespace

VtuGrid meshGrid(const RecordedRun& run, const std::vector<std::size_t>& which, const RecordedFrame* frame) {
  MeshArrays arrays;
  for (const std::size_t b : which) addMesh(run, b, frame, arrays);
  VtuGrid grid;
  grid.points = {"Points", 3, std::move(arrays.points)};
  grid.corners = std::move(arrays.corners);
  grid.point_data.push_back({"displacement", 3, std::move(arrays.displacement)});
  if (!arrays.von_mises.empty()) grid.point_data.push_back({"von_mises", 1, std::move(arrays.von_mises)});
  if (!arrays.force.empty()) grid.point_data.push_back({"contact_force", 3, std::move(arrays.force)});
  grid.cell_data.push_back({"body", 1, std::move(arrays.body)});
  if (!arrays.stress.empty()) {
    grid.cell_data.push_back({"stress", 6, std::move(arrays.stress)});
    grid.cell_data.push_back({"von_mises", 1, std::move(arrays.cell_von_mises)});
  }
  if (frame != nullptr) grid.time = frame->time;
  return grid;
}

Surface surfaceAt(const RecordedRun& run, const std::vector<std::size_t>& which, const RecordedFrame* frame) {
  Surface out;
  for (const std::size_t b : which) {
    const RecordedBody& body = run.bodies()[b];
    const auto first = static_cast<int>(out.vertices.size());
    const std::vector<float> points = onSurface(body, nodesOf(body, frame), 3);
    for (std::size_t v = 0; v < points.size() / 3; ++v) out.vertices.push_back(at(points, v));
    for (std::size_t t = 0; t < body.triangles.size(); t += 3)
      out.triangles.push_back(
          {first + body.triangles[t], first + body.triangles[t + 1], first + body.triangles[t + 2]});
  }
  return out;
}

std::size_t writeSeries(RecordedRun& run, const SeriesOptions& options, const std::filesystem::path& folder,
                        const SeriesProgress& progress) {
  SeriesOptions all = options;
  for (std::size_t b = 0; options.bodies.empty() && b < run.bodies().size(); ++b) all.bodies.push_back(b);
  constexpr double kSlack = 1e-9;
  std::vector<std::size_t> steps;
  for (std::size_t i = 0; i < run.times().size(); ++i) {
    if (run.times()[i] >= options.from - kSlack && run.times()[i] <= options.to + kSlack) steps.push_back(i);
  }
  if (steps.empty())
    throw InputError("--from", "",
                     fmt::format("there is no step between it and --to; there are some from {:g} to {:g} s",
                                 run.times().front(), run.times().back()));
  SeriesWriter writer(run, all, folder);
  std::size_t written = 0;
  for (std::size_t k = 0; k < steps.size(); k += static_cast<std::size_t>(options.every), ++written) {
    writer.add(run.frame(steps[k]), written);
    if (progress) progress(static_cast<double>(k) / static_cast<double>(steps.size()));
  }
  writer.finish();
  return written;
}

}  // namespace palpate
