#include "palpate/results/snapshots.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>

#include "palpate/mesh/embedding_map.h"
#include "palpate/picture/camera.h"
#include "palpate/picture/png.h"
#include "palpate/picture/render.h"
#include "palpate/picture/shapes.h"

namespace palpate {
namespace {

constexpr int kHeight = 480;                              // [px]
constexpr double kFieldOfView = 0.45;                     // [rad]
constexpr double kMargin = 0.07;                          // share of the picture
constexpr double kFaintForce = 0.1;                       // [N], below which no force has the longest arrow
constexpr double kWeakForce = 0.02;                       // [N], drawn as nothing
constexpr double kPenLength = 0.85, kArrowLength = 0.65;  // in radii of the scene
constexpr double kGrip = 0.72;                            // where on the pen the hand is
constexpr float kInside = 0.5F;                           // brightness of the inside of a mesh that is cut open
constexpr std::size_t kProbes = 60;                       // points of the tool, a picture, looked for in a socket
const Color kHandleColor(0.86F, 0.22F, 0.18F), kPenColor(0.20F, 0.22F, 0.25F), kForceColor(0.10F, 0.42F, 0.80F),
    kObstacleColor(0.74F, 0.73F, 0.70F);
const std::array<Color, 7> kBodyColors{
    Color(0.56F, 0.74F, 0.47F), Color(0.89F, 0.70F, 0.42F), Color(0.50F, 0.64F, 0.82F), Color(0.74F, 0.58F, 0.78F),
    Color(0.93F, 0.83F, 0.46F), Color(0.48F, 0.75F, 0.73F), Color(0.86F, 0.62F, 0.64F)};

/// Share of a surface point that moves with the handle.
float attachedShare(const BodyModel& body, const EmbeddedPoint& point) {
  if (!body.held() || point.tetrahedron < 0) return 0.0F;
  double share = 0;
  for (int k = 0; k < 4; ++k) {
    const int node = body.mesh().mesh.tetrahedra[point.tetrahedron][k];
    if (body.attachedIndex()[node] >= 0) share += point.weights[k];
  }
  return static_cast<float>(std::clamp(share, 0.0, 1.0));
}

/// All red from a share of 0.45: the surface lies between attached nodes and free ones outside of it, and hardly any of
/// it has a share of 1.
float tint(float share) {
  const float s = std::min(1.0F, share / 0.45F);
  return s * s * (3.0F - 2.0F * s);
}

/// Whether the ray from `origin` meets the triangle a, b, c (Moeller and Trumbore 1997).
bool meets(const Vec3& origin, const Vec3& direction, const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 e1 = b - a, e2 = c - a, p = direction.cross(e2), s = origin - a;
  const double determinant = e1.dot(p);
  if (determinant == 0.0) return false;
  const double u = s.dot(p) / determinant;
  if (u < 0.0 || u > 1.0) return false;
  const Vec3 q = s.cross(e1);
  const double v = direction.dot(q) / determinant;
  return v >= 0.0 && u + v <= 1.0 && e2.dot(q) / determinant > 0.0;
}

Eigen::AlignedBox3d boundsOf(const std::vector<Vec3>& points) {
  Eigen::AlignedBox3d bounds;
  for (const Vec3& x : points) bounds.extend(x);
  return bounds;
}

}  // namespace

Snapshots::Snapshots(const SceneConfig& config, const World& world, int count)
    : config_(config), world_(world), looking_along_(-config.viewFrom()) {
  for (int i = 0; i < count; ++i) due_.push_back(config.duration * (i + 0.5) / count);
}

RunSink Snapshots::watch(RunSink sink) {
  RunSink out = sink;
  out.tick = [this, pass = std::move(sink.tick)](const TickRecord& r) {
    if (!start_rotation_) start_rotation_ = r.device.pose.rotation;
    last_tick_ = r;
    pass(r);
  };
  out.visual = [this, pass = std::move(sink.visual)](const VisualRecord& r) {
    const double end = r.time + config_.visual_step;  // the bodies stand as at the end of the step
    if (shots_.size() < due_.size() && end >= due_[shots_.size()]) {
      Snapshot shot{end, {}, last_tick_.device.pose, last_tick_.sent.head<3>()};
      for (int i = 0; i < world_.bodies(); ++i) shot.nodes.push_back(world_.body(i).state.positions);
      shots_.push_back(std::move(shot));
    }
    pass(r);
  };
  return out;
}

PictureMesh Snapshots::bodyMesh(int body, const Snapshot& shot) const {
  const BodyModel& b = world_.body(body).model;
  const SimulationMesh& mesh = b.mesh();
  const VecX points = EmbeddingMap(mesh.mesh, mesh.embedding).interpolate(shot.nodes[body]);
  PictureMesh out;
  out.triangles = mesh.surface.triangles;
  const Color& own = kBodyColors[body % kBodyColors.size()];
  for (std::size_t i = 0; i < mesh.embedding.size(); ++i) {
    out.vertices.emplace_back(points.segment<3>(3 * static_cast<Eigen::Index>(i)));
    out.colors.emplace_back(own + tint(attachedShare(b, mesh.embedding[i])) * (kHandleColor - own));
  }
  return out;
}

std::vector<PictureMesh> Snapshots::obstacleMeshes() const {
  std::vector<PictureMesh> out;
  for (const Obstacle& obstacle : world_.obstacles) {
    if (const auto* box = std::get_if<BoxShape>(&obstacle.shape)) {
      out.push_back(boxMesh(box->pose, box->half_extents, kObstacleColor));
    } else if (const auto* sphere = std::get_if<SphereShape>(&obstacle.shape)) {
      out.push_back(capsuleMesh(sphere->center, sphere->center, sphere->radius, kObstacleColor));
    } else if (const auto* capsule = std::get_if<CapsuleShape>(&obstacle.shape)) {
      out.push_back(capsuleMesh(capsule->a, capsule->b, capsule->radius, kObstacleColor));
    } else if (const auto* mesh = std::get_if<MeshShape>(&obstacle.shape)) {
      PictureMesh whole;
      whole.vertices = mesh->surface.vertices;
      whole.triangles = mesh->surface.triangles;
      whole.colors = {kObstacleColor};
      whole.inside = kInside;
      if (surroundsTool(mesh->surface)) {
        const Vec3 away = Vec3(looking_along_.x(), looking_along_.y(), 0.0).normalized();  // an upright section
        out.push_back(cutOpen(whole, boundsOf(whole.vertices).center(), away));
      } else {
        out.push_back(std::move(whole));
      }
    }
  }
  return out;
}

/// Whether a point of the tool, in any picture, has the surface on its four sides: in front, behind, left and right.
bool Snapshots::surroundsTool(const Surface& surface) const {
  const CameraFrame frame = cameraFrame(looking_along_);
  const Vec3 ahead = Vec3::UnitZ().cross(frame.right);
  const Eigen::AlignedBox3d bounds = boundsOf(surface.vertices);
  int tool = 0;
  while (tool < world_.bodies() && !world_.body(tool).model.held()) ++tool;
  if (tool == world_.bodies()) return false;
  const auto hidden = [&](const Vec3& x, const Vec3& direction) {
    return std::any_of(surface.triangles.begin(), surface.triangles.end(), [&](const std::array<int, 3>& t) {
      return meets(x, direction, surface.vertices[t[0]], surface.vertices[t[1]], surface.vertices[t[2]]);
    });
  };
  for (const Snapshot& shot : shots_) {
    const std::vector<Vec3> points = bodyMesh(tool, shot).vertices;
    const std::size_t stride = std::max<std::size_t>(1, points.size() / kProbes);
    for (std::size_t i = 0; i < points.size(); i += stride) {
      const Vec3& x = points[i];
      if (bounds.contains(x) && hidden(x, -ahead) && hidden(x, ahead) && hidden(x, frame.right) &&
          hidden(x, -frame.right)) {
        return true;
      }
    }
  }
  return false;
}

/// The hand holds a pen whose tip is at the device's position and that turns with the device.
Vec3 Snapshots::penAxis(const Snapshot& shot) const {
  const CameraFrame frame = cameraFrame(looking_along_);
  const Quat turned = shot.device.rotation * start_rotation_.value_or(shot.device.rotation).conjugate();
  return (turned * (Vec3::UnitZ() + 0.5 * frame.right)).normalized();
}

Vec3 Snapshots::grip(const Snapshot& shot) const { return shot.device.position + kGrip * pen_length_ * penAxis(shot); }

PictureScene Snapshots::sceneAt(const Snapshot& shot, const PictureScene& common) const {
  PictureScene scene = common;
  for (int i = 0; i < world_.bodies(); ++i) scene.meshes.push_back(bodyMesh(i, shot));
  scene.meshes.push_back(penMesh(shot.device.position, penAxis(shot), pen_length_, kPenColor));
  if (shot.force.norm() > kWeakForce) {
    const Vec3 tail = grip(shot), tip = tail + meters_per_newton_ * shot.force;
    scene.meshes.push_back(arrowMesh(tail, tip, 0.045 * pen_length_, kForceColor));
  }
  return scene;
}

/// All points of the bodies, in any picture, and of what is no larger than they are and thus seen whole.
std::vector<Vec3> Snapshots::pointsToSee(const std::vector<PictureMesh>& obstacles) const {
  std::vector<Vec3> seen;
  for (const Snapshot& shot : shots_) {
    for (int i = 0; i < world_.bodies(); ++i) {
      const std::vector<Vec3> vertices = bodyMesh(i, shot).vertices;
      seen.insert(seen.end(), vertices.begin(), vertices.end());
    }
  }
  const double size = boundsOf(seen).diagonal().norm();
  for (const PictureMesh& mesh : obstacles) {
    if (boundsOf(mesh.vertices).diagonal().norm() <= size) {
      seen.insert(seen.end(), mesh.vertices.begin(), mesh.vertices.end());
    }
  }
  return seen;
}

double Snapshots::strongestForce() const {
  double strongest = kFaintForce;
  for (const Snapshot& shot : shots_) strongest = std::max(strongest, shot.force.norm());
  return strongest;
}

/// What all pictures share, camera included. @param width  of a picture [px], which is chosen here
PictureScene Snapshots::commonScene(double strongest, int& width) {
  PictureScene common;
  common.meshes = obstacleMeshes();
  std::vector<Vec3> seen = pointsToSee(common.meshes);
  const Eigen::AlignedBox3d bounds = boundsOf(seen);
  common.focus = bounds.center();
  common.radius = 0.5 * bounds.diagonal().norm();
  common.grid = gridSpacing(2.0 * common.radius);
  for (const Obstacle& obstacle : world_.obstacles) {
    if (const auto* plane = std::get_if<PlaneShape>(&obstacle.shape))
      common.planes.push_back({plane->point, plane->normal});
  }
  pen_length_ = kPenLength * common.radius;
  meters_per_newton_ = kArrowLength * common.radius / strongest;
  for (const Snapshot& shot : shots_) {
    seen.push_back(grip(shot) + meters_per_newton_ * shot.force);
    seen.push_back(shot.device.position + pen_length_ * penAxis(shot));
  }
  // a little wider than the bodies need, for the shadow beside them
  const double aspect = std::min(1.18 * fitAspect(seen, looking_along_, kFieldOfView, 0.7, 1.6, kMargin), 1.6);
  width = static_cast<int>(std::lround(kHeight * aspect));
  common.camera = fitCamera(seen, looking_along_, kFieldOfView, static_cast<double>(width) / kHeight, kMargin);
  return common;
}

Image Snapshots::imageOf(const Snapshot& shot, const Bitmap& bitmap) const {
  Image image;
  image.title = fmt::format("{:.1f} s, {:.2f} N", shot.time, shot.force.norm());
  image.alt = fmt::format("{} at {:.1f} s, the part that is held in red; force on the hand {:.2f} N", config_.name,
                          shot.time, shot.force.norm());
  image.png = encodePng(bitmap);
  return image;
}

RunPictures Snapshots::draw() {
  RunPictures out;
  if (shots_.empty()) return out;
  const double strongest = strongestForce();
  int width = 0;
  const PictureScene common = commonScene(strongest, width);
  std::vector<Bitmap> bitmaps;
  for (const Snapshot& shot : shots_) {
    bitmaps.push_back(render(sceneAt(shot, common), width, kHeight));
    out.images.push_back(imageOf(shot, bitmaps.back()));
  }
  out.sheet = encodePng(sheet(bitmaps, 3, 10));
  out.note = fmt::format(
      "Red is what the hand holds, with the pen; the arrow is the force on the hand, the longest {:.2g} N. The grid's "
      "lines are {:.3g} mm apart.",
      strongest, 1e3 * common.grid);
  return out;
}

}  // namespace palpate
