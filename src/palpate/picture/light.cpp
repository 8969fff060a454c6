#include "palpate/picture/light.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace palpate {

namespace {

using Vec3f = Eigen::Vector3f;

const Vec3f kKeyColor(0.80F, 0.77F, 0.72F);
const Vec3f kSkyColor(0.44F, 0.46F, 0.50F);
const Vec3f kBounceColor(0.20F, 0.19F, 0.18F);  // what the light floor sends up
const Vec3f kFillColor(0.07F, 0.08F, 0.10F);
const Vec3f kRimColor(0.16F, 0.17F, 0.19F);
constexpr int kKeyLamps = 14;
constexpr float kKeySpread = 0.12F;  // radius of the main lamp as seen from the scene [rad]
constexpr int kKeyMapSize = 320, kSkyMapSize = 144;
constexpr float kGoldenAngle = 2.39996323F;

Vec3f unitOrthogonal(const Vec3f& w) { return w.unitOrthogonal(); }

}  // namespace

DepthMap::DepthMap(const Vec3f& towards, float radius, int size)
    : u_(unitOrthogonal(towards)),
      v_(towards.cross(u_)),
      w_(towards),
      scale_(static_cast<float>(size) / (2.0F * radius)),
      offset_(0.5F * static_cast<float>(size)),
      bias_(1.0F / scale_),
      size_(size),
      depth_(static_cast<std::size_t>(size) * size, -std::numeric_limits<float>::infinity()) {}

void DepthMap::draw(const SmoothMesh& mesh) {
  std::vector<Vec3f> points(mesh.positions.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3f& x = mesh.positions[i];
    points[i] = {scale_ * u_.dot(x) + offset_ - 0.5F, scale_ * v_.dot(x) + offset_ - 0.5F, w_.dot(x)};
  }
  const auto last = static_cast<float>(size_ - 1);
  for (const auto& [i, j, k] : mesh.triangles) {
    const Vec3f &a = points[i], &b = points[j], &c = points[k];
    // pixels, by their centers at whole numbers, in the triangle's bounding box
    const float left = std::max(0.0F, std::ceil(std::min({a.x(), b.x(), c.x()})));
    const float right = std::min(last, std::floor(std::max({a.x(), b.x(), c.x()})));
    const float top = std::max(0.0F, std::ceil(std::min({a.y(), b.y(), c.y()})));
    const float bottom = std::min(last, std::floor(std::max({a.y(), b.y(), c.y()})));
    if (!(left <= right && top <= bottom)) continue;
    const float area = (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
    if (area == 0.0F) continue;
    const float scale = 1.0F / area;
    for (float y = top; y <= bottom; ++y) {
      float* row = depth_.data() + static_cast<std::ptrdiff_t>(y) * size_;
      for (float x = left; x <= right; ++x) {
        const float wb = scale * ((x - a.x()) * (c.y() - a.y()) - (y - a.y()) * (c.x() - a.x()));
        const float wc = scale * ((b.x() - a.x()) * (y - a.y()) - (b.y() - a.y()) * (x - a.x()));
        if (wb < 0.0F || wc < 0.0F || wb + wc > 1.0F) continue;
        float& depth = row[static_cast<std::ptrdiff_t>(x)];
        depth = std::max(depth, a.z() + wb * (b.z() - a.z()) + wc * (c.z() - a.z()));
      }
    }
  }
}

float DepthMap::visibility(const Vec3f& x) const {
  const float px = scale_ * u_.dot(x) + offset_ - 0.5F, py = scale_ * v_.dot(x) + offset_ - 0.5F;
  const auto last = static_cast<float>(size_ - 1);
  if (!(px >= 0.0F && py >= 0.0F && px < last && py < last)) return 1.0F;
  const int ix = static_cast<int>(px), iy = static_cast<int>(py);
  const float fx = px - static_cast<float>(ix), fy = py - static_cast<float>(iy);
  const float* row = depth_.data() + static_cast<std::ptrdiff_t>(iy) * size_ + ix;
  const float own = w_.dot(x) + bias_;
  const float a = row[0] <= own ? 1.0F : 0.0F, b = row[1] <= own ? 1.0F : 0.0F;
  const float c = row[size_] <= own ? 1.0F : 0.0F, d = row[size_ + 1] <= own ? 1.0F : 0.0F;
  return (1.0F - fy) * (a + fx * (b - a)) + fy * (c + fx * (d - c));
}

Studio::Studio(const std::vector<const SmoothMesh*>& casters, float radius, const Vec3f& right, const Vec3f& forward) {
  const Vec3f up = Vec3f::UnitZ(), level = (forward - forward.z() * up).normalized();
  key_direction_ = (-0.55F * right - 0.42F * level + 1.05F * up).normalized();
  fill_direction_ = (0.8F * right - 0.6F * level + 0.35F * up).normalized();
  rim_direction_ = (0.45F * right + 0.8F * level + 0.5F * up).normalized();
  std::size_t triangles = 0;
  for (const SmoothMesh* mesh : casters) triangles += mesh->triangles.size();
  const int skies = triangles > 30000 ? 40 : 60;
  const Vec3f u = unitOrthogonal(key_direction_), v = key_direction_.cross(u);
  for (int i = 0; i < kKeyLamps; ++i) {
    const float r = kKeySpread * std::sqrt((static_cast<float>(i) + 0.5F) / kKeyLamps);
    const float angle = kGoldenAngle * static_cast<float>(i);
    const Vec3f towards = (key_direction_ + r * std::cos(angle) * u + r * std::sin(angle) * v).normalized();
    maps_.emplace_back(towards, radius, kKeyMapSize);
  }
  keys_ = maps_.size();
  for (int i = 0; i < skies; ++i) {
    const float z = (static_cast<float>(i) + 0.5F) / static_cast<float>(skies);
    const float angle = kGoldenAngle * static_cast<float>(i), r = std::sqrt(1.0F - z * z);
    maps_.emplace_back(Vec3f(r * std::cos(angle), r * std::sin(angle), z), radius, kSkyMapSize);
  }
  for (DepthMap& map : maps_) {
    for (const SmoothMesh* mesh : casters) map.draw(*mesh);
  }
  texel_ = 2.0F * radius / kSkyMapSize;
}

template <class Visibility>
Illumination Studio::sum(const Vec3f& normal, const Visibility& visibility) const {
  Illumination out;
  const float key_cosine = std::max(0.0F, normal.dot(key_direction_));
  if (key_cosine > 0.0F) {
    for (std::size_t i = 0; i < keys_; ++i) out.key += visibility(maps_[i]) / static_cast<float>(keys_);
  }
  // the sky's lamps cover the hemisphere evenly: with 2 / count, an open face that looks up gets 1
  float sky = 0.0F, all = 0.0F;
  for (std::size_t i = keys_; i < maps_.size(); ++i) {
    const float cosine = normal.dot(maps_[i].towards());
    if (cosine <= 0.0F) continue;
    all += cosine;
    sky += cosine * visibility(maps_[i]);
  }
  out.open = all > 0.0F ? sky / all : 0.0F;
  sky *= 2.0F / static_cast<float>(maps_.size() - keys_);
  out.light = key_cosine * out.key * kKeyColor + sky * kSkyColor;
  out.light += 0.5F * (1.0F - normal.z()) * (0.35F + 0.65F * out.open) * kBounceColor;
  out.light += std::max(0.0F, normal.dot(fill_direction_)) * out.open * kFillColor;
  out.light += std::max(0.0F, normal.dot(rim_direction_)) * out.open * kRimColor;
  return out;
}

Illumination Studio::at(const Vec3f& x, const Vec3f& normal, float shift) const {
  const Vec3f point = x + shift * normal;
  return sum(normal, [&](const DepthMap& map) { return map.visibility(point); });
}

Illumination Studio::open(const Vec3f& normal) const {
  return sum(normal, [](const DepthMap&) { return 1.0F; });
}

}  // namespace palpate
