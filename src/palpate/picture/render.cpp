#include "palpate/picture/render.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "palpate/picture/camera.h"
#include "palpate/picture/light.h"
#include "palpate/picture/smooth_mesh.h"

namespace palpate {

namespace {

using Vec3f = Eigen::Vector3f;

constexpr int kSamples = 2;            // a side of a pixel
constexpr int kPlaneTexels = 220;      // a side of a plane's light image
constexpr float kPlaneReach = 2.2F;    // of that image, in radii of the scene
constexpr float kShadowReach = 1.6F;   // of the lamps' depth images
constexpr float kFinestEdge = 0.035F;  // mesh edges that light is computed at, in radii
constexpr std::size_t kRefineLimit = 30000;
const Vec3f kBackground(0.905F, 0.914F, 0.926F);  // linear; about #f3f4f6 on the screen
const Vec3f kGridTint(0.62F, 0.66F, 0.71F);

/// From linear light to a byte for the screen.
class ScreenTable {
 public:
  ScreenTable() {
    for (int i = 0; i < kSize; ++i) {
      const float x = static_cast<float>(i) / (kSize - 1);
      const float screen = x <= 0.0031308F ? 12.92F * x : 1.055F * std::pow(x, 1.0F / 2.4F) - 0.055F;
      table_[i] = static_cast<unsigned char>(std::lround(255.0F * screen));
    }
  }
  unsigned char operator()(float x) const {
    return table_[static_cast<int>(std::clamp(x, 0.0F, 1.0F) * (kSize - 1) + 0.5F)];
  }

 private:
  static constexpr int kSize = 4096;
  std::array<unsigned char, kSize> table_{};
};

/// Leaves dark colors as they are and bends what is too bright towards 1.
float shoulder(float x) {
  constexpr float kStart = 0.7F;
  if (x <= kStart) return x;
  const float over = (x - kStart) / (1.0F - kStart);
  return kStart + (1.0F - kStart) * over / (1.0F + 0.55F * over);
}

float smoothStep(float from, float to, float x) {
  const float s = std::clamp((x - from) / (to - from), 0.0F, 1.0F);
  return s * s * (3.0F - 2.0F * s);
}

/// A mesh made ready: geometry about the scene's focus, light at its vertices.
struct LitMesh {
  SmoothMesh mesh;
  std::vector<Illumination> light;
  float gloss = 0, inside = 1;
  bool on_top = false;
};

/// A plane with the light on its part near the focus.
struct LitPlane {
  Vec3f point, normal, u, v, center;
  float reach = 0;           // half side of the image [m]
  std::vector<Vec3f> shade;  // light with shadows over light without, kPlaneTexels squared
  // inverse depth = slope_x * x + slope_y * y + constant, sample coordinates
  float slope_x = 0, slope_y = 0, constant = 0;
};

struct Sample {
  float inverse_depth = 0;  // 0: nothing
  int mesh = -1;            // index of the mesh; -1: nothing
  int triangle = -1;
};

class Painter {
 public:
  Painter(const PictureScene& scene, int width, int height) : scene_(scene), width_(width), height_(height) {
    setCamera();
    prepareMeshes();
    lightEverything();
    for (std::size_t i = 0; i < meshes_.size(); ++i) {
      if (!meshes_[i].on_top) rasterize(static_cast<int>(i), samples_);
    }
    for (std::size_t i = 0; i < meshes_.size(); ++i) {
      if (meshes_[i].on_top) rasterize(static_cast<int>(i), top_);
    }
  }

  Bitmap paint() const {
    const ScreenTable screen;
    Bitmap out{width_, height_, std::vector<unsigned char>(static_cast<std::size_t>(3) * width_ * height_)};
    unsigned char* byte = out.rgb.data();
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) {
        const Vec3f color = pixel(x, y);
        for (int k = 0; k < 3; ++k) *byte++ = screen(color[k]);
      }
    }
    return out;
  }

 private:
  Vec3f local(const Vec3& x) const { return (x - scene_.focus).cast<float>(); }

  void setCamera() {
    columns_ = kSamples * width_;
    rows_ = kSamples * height_;
    const CameraFrame frame = cameraFrame(scene_.camera.direction);
    right_ = frame.right.cast<float>();
    up_ = frame.up.cast<float>();
    forward_ = frame.forward.cast<float>();
    eye_ = local(scene_.camera.eye);
    focal_ = 0.5F * static_cast<float>(rows_) / static_cast<float>(std::tan(0.5 * scene_.camera.field_of_view));
    center_x_ = 0.5F * static_cast<float>(columns_);
    center_y_ = 0.5F * static_cast<float>(rows_);
    near_ = 1e-3F * static_cast<float>(scene_.radius);
    samples_.resize(static_cast<std::size_t>(columns_) * rows_);
    const bool any_on_top =
        std::any_of(scene_.meshes.begin(), scene_.meshes.end(), [](const auto& m) { return m.on_top; });
    if (any_on_top) top_.resize(samples_.size());
  }

  void prepareMeshes() {
    for (const PictureMesh& mesh : scene_.meshes) {
      if (mesh.triangles.empty()) continue;
      check(mesh);
      meshes_.push_back({smoothMesh(mesh, scene_.focus), {}, mesh.gloss, mesh.inside, mesh.on_top});
    }
  }

  static void check(const PictureMesh& mesh) {
    const int count = static_cast<int>(mesh.vertices.size());
    for (const auto& triangle : mesh.triangles) {
      for (const int v : triangle) {
        if (v < 0 || v >= count) throw std::logic_error("picture: a triangle without vertices");
      }
    }
    if (mesh.colors.size() != 1 && mesh.colors.size() != mesh.vertices.size()) {
      throw std::logic_error("picture: one color, or one a vertex");
    }
  }

  void lightEverything() {
    const float radius = static_cast<float>(scene_.radius);
    std::vector<const SmoothMesh*> casters;
    for (const LitMesh& mesh : meshes_) {
      if (!mesh.on_top) casters.push_back(&mesh.mesh);
    }
    const Studio studio(casters, kShadowReach * radius, right_, forward_);
    key_direction_ = studio.keyDirection();
    for (LitMesh& mesh : meshes_) {
      refine(mesh.mesh, kFinestEdge * radius, kRefineLimit);
      mesh.light.resize(mesh.mesh.positions.size());
      for (std::size_t i = 0; i < mesh.light.size(); ++i) {
        mesh.light[i] = mesh.on_top ? studio.open(mesh.mesh.normals[i])
                                    : studio.at(mesh.mesh.positions[i], mesh.mesh.normals[i], 1.2F * studio.texel());
      }
    }
    for (const PicturePlane& plane : scene_.planes) addPlane(plane, studio);
  }

  void addPlane(const PicturePlane& plane, const Studio& studio) {
    LitPlane lit;
    lit.point = local(plane.point);
    lit.normal = plane.normal.cast<float>();
    const float height = lit.normal.dot(eye_ - lit.point);
    if (height <= 0.0F) return;  // seen from behind
    const Vec3f& n = lit.normal;
    lit.u = std::abs(n.x()) < 0.9F ? Vec3f(Vec3f::UnitX() - n.x() * n).normalized()
                                   : Vec3f(Vec3f::UnitY() - n.y() * n).normalized();
    lit.v = n.cross(lit.u);
    lit.center = n.dot(lit.point) * n;  // the focus is the origin
    lit.reach = kPlaneReach * static_cast<float>(scene_.radius);
    // x = eye + d s lies in the plane at s = -height / (n . d); d has unit length along the line of sight
    lit.slope_x = -n.dot(right_) / (focal_ * height);
    lit.slope_y = n.dot(up_) / (focal_ * height);
    lit.constant = -n.dot(forward_) / height - lit.slope_x * center_x_ - lit.slope_y * center_y_;
    const Vec3f open = studio.open(n).light;
    lit.shade.resize(static_cast<std::size_t>(kPlaneTexels) * kPlaneTexels);
    for (int j = 0; j < kPlaneTexels; ++j) {
      for (int i = 0; i < kPlaneTexels; ++i) {
        const float a = texelPlace(i, lit.reach), b = texelPlace(j, lit.reach);
        const Vec3f x = lit.center + a * lit.u + b * lit.v;
        lit.shade[static_cast<std::size_t>(j) * kPlaneTexels + i] = studio.at(x, n, 0.0F).light.cwiseQuotient(open);
      }
    }
    blur(lit.shade, 1, kPlaneTexels);
    blur(lit.shade, kPlaneTexels, 1);
    planes_.push_back(std::move(lit));
  }

  /// Weights 1 4 6 4 1 along one direction of a square image: hides the edges of the many lamps' shadows.
  static void blur(std::vector<Vec3f>& image, std::ptrdiff_t along, std::ptrdiff_t across) {
    std::vector<Vec3f> line(kPlaneTexels);
    for (int j = 0; j < kPlaneTexels; ++j) {
      Vec3f* first = image.data() + j * across;
      for (int i = 0; i < kPlaneTexels; ++i) line[i] = first[i * along];
      const auto old = [&](int i) -> const Vec3f& { return line[std::clamp(i, 0, kPlaneTexels - 1)]; };
      for (int i = 0; i < kPlaneTexels; ++i) {
        first[i * along] = (6.0F * old(i) + 4.0F * (old(i - 1) + old(i + 1)) + old(i - 2) + old(i + 2)) / 16.0F;
      }
    }
  }

  static float texelPlace(int i, float reach) {
    return reach * (2.0F * (static_cast<float>(i) + 0.5F) / kPlaneTexels - 1.0F);
  }

  // --- geometry to samples

  struct Projected {
    float x, y, inverse_depth;
  };

  Projected project(const Vec3f& x) const {
    const Vec3f d = x - eye_;
    const float inverse = 1.0F / forward_.dot(d);
    return {center_x_ + focal_ * inverse * right_.dot(d), center_y_ - focal_ * inverse * up_.dot(d), inverse};
  }

  void rasterize(int index, std::vector<Sample>& samples) const {
    const SmoothMesh& mesh = meshes_[index].mesh;
    std::vector<Projected> points(mesh.positions.size());
    std::vector<char> behind(mesh.positions.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      behind[i] = forward_.dot(mesh.positions[i] - eye_) < near_;
      if (behind[i] == 0) points[i] = project(mesh.positions[i]);
    }
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      const auto& [a, b, c] = mesh.triangles[t];
      if (behind[a] + behind[b] + behind[c] == 0) {
        fill(points[a], points[b], points[c], index, static_cast<int>(t), samples);
      } else if (behind[a] + behind[b] + behind[c] < 3) {
        clip(index, static_cast<int>(t), samples);
      }
    }
  }

  // The part of a triangle that is in front of the camera: three or four corners.
  void clip(int index, int triangle, std::vector<Sample>& samples) const {
    const SmoothMesh& mesh = meshes_[index].mesh;
    std::array<Projected, 4> corners{};
    int count = 0;
    for (int k = 0; k < 3; ++k) {
      const Vec3f& x = mesh.positions[mesh.triangles[triangle][k]];
      const Vec3f& y = mesh.positions[mesh.triangles[triangle][(k + 1) % 3]];
      const float a = forward_.dot(x - eye_) - near_, b = forward_.dot(y - eye_) - near_;
      if (a >= 0.0F) corners[count++] = project(x);
      if ((a >= 0.0F) != (b >= 0.0F)) {
        const Vec3f cut = x + a / (a - b) * (y - x);
        corners[count++] = project(cut + 1e-3F * near_ * forward_);
      }
    }
    for (int k = 2; k < count; ++k) fill(corners[0], corners[k - 1], corners[k], index, triangle, samples);
  }

  void fill(const Projected& a, const Projected& b, const Projected& c, int mesh, int triangle,
            std::vector<Sample>& samples) const {
    const auto bound = [](float value, int last) {
      return static_cast<int>(std::clamp(value, -1.0F, static_cast<float>(last) + 1.0F));
    };
    const float area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    if (!(std::abs(area) > 0.0F)) return;  // nothing to see, or a corner that is not a number
    const int left = std::max(0, bound(std::ceil(std::min({a.x, b.x, c.x}) - 0.5F), columns_));
    const int right = std::min(columns_ - 1, bound(std::floor(std::max({a.x, b.x, c.x}) - 0.5F), columns_));
    const int top = std::max(0, bound(std::ceil(std::min({a.y, b.y, c.y}) - 0.5F), rows_));
    const int bottom = std::min(rows_ - 1, bound(std::floor(std::max({a.y, b.y, c.y}) - 0.5F), rows_));
    if (left > right || top > bottom) return;
    const float scale = 1.0F / area;
    const float db = b.inverse_depth - a.inverse_depth, dc = c.inverse_depth - a.inverse_depth;
    for (int j = top; j <= bottom; ++j) {
      const float y = static_cast<float>(j) + 0.5F - a.y;
      Sample* row = samples.data() + static_cast<std::ptrdiff_t>(j) * columns_;
      for (int i = left; i <= right; ++i) {
        const float x = static_cast<float>(i) + 0.5F - a.x;
        const float wb = scale * (x * (c.y - a.y) - y * (c.x - a.x));
        const float wc = scale * ((b.x - a.x) * y - (b.y - a.y) * x);
        if (wb < 0.0F || wc < 0.0F || wb + wc > 1.0F) continue;
        const float inverse = a.inverse_depth + wb * db + wc * dc;
        if (inverse > row[i].inverse_depth) row[i] = {inverse, mesh, triangle};
      }
    }
  }

  // --- samples to colors

  Vec3f lineOfSight(float x, float y) const {
    return forward_ + (x - center_x_) / focal_ * right_ - (y - center_y_) / focal_ * up_;
  }

  Vec3f pixel(int x, int y) const {
    Vec3f sum = Vec3f::Zero(), ground;
    int ground_plane = -2;  // the one that `ground` is the color of
    for (int j = kSamples * y; j < kSamples * (y + 1); ++j) {
      for (int i = kSamples * x; i < kSamples * (x + 1); ++i) {
        const std::size_t at = static_cast<std::size_t>(j) * columns_ + i;
        const float sx = static_cast<float>(i) + 0.5F, sy = static_cast<float>(j) + 0.5F;
        if (!top_.empty() && top_[at].mesh >= 0) {
          sum += surface(top_[at], sx, sy);
          continue;
        }
        const int plane = planeAt(sx, sy, samples_[at].inverse_depth);
        if (plane < 0 && samples_[at].mesh >= 0) {
          sum += surface(samples_[at], sx, sy);
          continue;
        }
        if (plane != ground_plane) {  // smooth within a pixel: once for all its samples
          ground_plane = plane;
          ground =
              planeColor(plane, kSamples * (static_cast<float>(x) + 0.5F), kSamples * (static_cast<float>(y) + 0.5F));
        }
        sum += ground;
      }
    }
    return sum / static_cast<float>(kSamples * kSamples);
  }

  /// The nearest plane that is nearer than the given depth; -1: none.
  int planeAt(float x, float y, float inverse_depth) const {
    int best = -1;
    for (std::size_t k = 0; k < planes_.size(); ++k) {
      const float inverse = planes_[k].slope_x * x + planes_[k].slope_y * y + planes_[k].constant;
      if (inverse <= inverse_depth) continue;
      inverse_depth = inverse;
      best = static_cast<int>(k);
    }
    return best;
  }

  Vec3f planeColor(int index, float x, float y) const {
    if (index < 0) return kBackground;
    const LitPlane& plane = planes_[index];
    const float inverse = plane.slope_x * x + plane.slope_y * y + plane.constant;
    if (!(inverse > 0.0F)) return kBackground;
    const float distance = 1.0F / inverse;
    const Vec3f sight = lineOfSight(x, y);
    const Vec3f from_center = eye_ + distance * sight - plane.center;
    const float a = plane.u.dot(from_center), b = plane.v.dot(from_center);
    const float radius = static_cast<float>(scene_.radius);
    const float fade = 1.0F - smoothStep(1.1F * radius, 3.6F * radius, std::hypot(a, b));
    if (fade <= 0.0F) return kBackground;
    Vec3f color = kBackground;
    if (scene_.grid > 0.0) {
      const float width = kSamples * distance / focal_;  // of a pixel, across the line of sight [m]
      const float steep = std::max(0.05F, -plane.normal.dot(sight.normalized()));
      const float line = std::max(gridLine(a + plane.u.dot(plane.center - plane.point), width, steep),
                                  gridLine(b + plane.v.dot(plane.center - plane.point), width, steep));
      color -= 0.75F * fade * line * (color - kGridTint);
    }
    return color.cwiseProduct(planeShade(plane, a, b));
  }

  /// How much of a pixel a grid line covers, 0 to 1.
  float gridLine(float place, float width, float steep) const {
    const auto spacing = static_cast<float>(scene_.grid);
    const float off = std::abs(place - spacing * std::round(place / spacing));
    const float half = 0.55F * width + 0.004F * spacing;
    const float soft = 0.5F * width / steep + 1e-12F;
    const float covered = std::clamp((half + soft - off) / (2.0F * soft), 0.0F, 1.0F);
    return covered * std::min(1.0F, 2.0F * half / soft);
  }

  static Vec3f planeShade(const LitPlane& plane, float a, float b) {
    const auto place = [&](float x) {
      const float texel = (x / plane.reach + 1.0F) * 0.5F * kPlaneTexels - 0.5F;
      return std::clamp(texel, 0.0F, static_cast<float>(kPlaneTexels) - 1.001F);
    };
    const float x = place(a), y = place(b);
    const int i = static_cast<int>(x), j = static_cast<int>(y);
    const float fx = x - static_cast<float>(i), fy = y - static_cast<float>(j);
    const Vec3f* row = plane.shade.data() + static_cast<std::ptrdiff_t>(j) * kPlaneTexels + i;
    const Vec3f shade = (1.0F - fy) * ((1.0F - fx) * row[0] + fx * row[1]) +
                        fy * ((1.0F - fx) * row[kPlaneTexels] + fx * row[kPlaneTexels + 1]);
    // What is nearly unshaded counts as unshaded: no gray haze far from the bodies, and a smaller file.
    const Vec3f clear = (shade / 0.97F).cwiseMin(1.0F);
    const float rim = smoothStep(0.75F, 1.0F, std::max(std::abs(a), std::abs(b)) / plane.reach);
    return clear + rim * (Vec3f::Ones() - clear);
  }

  Vec3f surface(const Sample& sample, float x, float y) const {
    const LitMesh& lit = meshes_[sample.mesh];
    const SmoothMesh& mesh = lit.mesh;
    const auto& [ia, ib, ic] = mesh.triangles[sample.triangle];
    const Vec3f sight = lineOfSight(x, y);
    // where the line of sight meets the triangle (Moeller and Trumbore 1997)
    const Vec3f e1 = mesh.positions[ib] - mesh.positions[ia], e2 = mesh.positions[ic] - mesh.positions[ia];
    const Vec3f p = sight.cross(e2);
    const float determinant = e1.dot(p);
    float wb = 0.0F, wc = 0.0F;
    if (determinant != 0.0F) {
      const Vec3f s = eye_ - mesh.positions[ia];
      wb = std::clamp(s.dot(p) / determinant, 0.0F, 1.0F);
      wc = std::clamp(sight.dot(s.cross(e1)) / determinant, 0.0F, 1.0F - wb);
    }
    const float wa = 1.0F - wb - wc;
    const Illumination &la = lit.light[ia], &lb = lit.light[ib], &lc = lit.light[ic];
    const Vec3f color = wa * mesh.colors[ia] + wb * mesh.colors[ib] + wc * mesh.colors[ic];
    const Vec3f light = wa * la.light + wb * lb.light + wc * lc.light;
    const float key = wa * la.key + wb * lb.key + wc * lc.key;
    const float open = wa * la.open + wb * lb.open + wc * lc.open;
    const Vec3f towards = -sight.normalized();
    Vec3f normal = (wa * mesh.normals[ia] + wb * mesh.normals[ib] + wc * mesh.normals[ic]).normalized();
    const bool inside = e1.cross(e2).dot(sight) > 0.0F;
    if (inside) normal = -normal;
    const Vec3f half = (key_direction_ + towards).normalized();
    const float shine = std::pow(std::max(0.0F, normal.dot(half)), 36.0F);
    const float facing = std::clamp(normal.dot(towards), 0.0F, 1.0F);
    const float edge = (1.0F - facing) * (1.0F - facing) * (1.0F - facing);
    Vec3f out = color.cwiseProduct(light);
    out.array() += lit.gloss * key * shine + 0.16F * edge * open * (0.5F + 0.5F * normal.z());
    if (inside) out *= lit.inside;
    return out.unaryExpr(&shoulder);
  }

  const PictureScene& scene_;
  int width_, height_, columns_ = 0, rows_ = 0;
  Vec3f eye_, right_, up_, forward_, key_direction_;
  float focal_ = 1, center_x_ = 0, center_y_ = 0, near_ = 0;
  std::vector<LitMesh> meshes_;
  std::vector<LitPlane> planes_;
  std::vector<Sample> samples_, top_;  // top_ is empty where no mesh is drawn on top
};

}  // namespace

Bitmap render(const PictureScene& scene, int width, int height) {
  if (width < 1 || height < 1 || width > 8192 || height > 8192) throw std::logic_error("picture: a size out of range");
  return Painter(scene, width, height).paint();
}

}  // namespace palpate
