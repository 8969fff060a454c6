#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "palpate/picture/camera.h"
#include "palpate/picture/png.h"
#include "palpate/picture/render.h"
#include "palpate/picture/shapes.h"
#include "palpate/picture/smooth_mesh.h"
#include "shared/png_pixels.h"

namespace palpate {
namespace {

const Color kRed(0.85F, 0.1F, 0.1F), kBlue(0.1F, 0.2F, 0.8F);

PictureScene ballOnGround() {
  PictureScene scene;
  scene.meshes.push_back(capsuleMesh({0, 0, 0.1}, {0, 0, 0.1}, 0.1, kRed));
  scene.planes.push_back({});
  scene.focus = {0, 0, 0.1};
  scene.radius = 0.15;
  scene.grid = 0;
  scene.camera = fitCamera(scene.meshes[0].vertices, {0.3, 1, -0.4}, 0.5, 1.0, 0.4);
  return scene;
}

struct Rgb {
  int r, g, b;
};
Rgb at(const Bitmap& image, int x, int y) {
  const unsigned char* p = image.rgb.data() + 3 * (y * image.width + x);
  return {p[0], p[1], p[2]};
}
bool isRed(const Rgb& c) { return c.r > c.g + 40 && c.r > c.b + 40; }
bool isBlue(const Rgb& c) { return c.b > c.r + 40; }

/// Where a point is seen, in pixels.
Eigen::Vector2d project(const PictureCamera& camera, const Vec3& x, int width, int height) {
  const CameraFrame frame = cameraFrame(camera.direction);
  const Vec3 d = x - camera.eye;
  const double focal = 0.5 * height / std::tan(0.5 * camera.field_of_view);
  return {0.5 * width + focal * d.dot(frame.right) / d.dot(frame.forward),
          0.5 * height - focal * d.dot(frame.up) / d.dot(frame.forward)};
}

double volume(const PictureMesh& mesh) {
  double sum = 0;
  for (const auto& [a, b, c] : mesh.triangles)
    sum += mesh.vertices[a].dot(mesh.vertices[b].cross(mesh.vertices[c])) / 6.0;
  return sum;
}

TEST(Camera, SeesAllPointsAndTouchesTheMargin) {
  const std::vector<Vec3> points{{0, 0, 0}, {0.3, 0.1, 0.2}, {-0.2, 0.4, 0.1}, {0.1, -0.3, 0.5}};
  for (const double aspect : {0.5, 1.0, 2.5}) {
    const PictureCamera camera = fitCamera(points, {0.2, 0.9, -0.5}, 0.6, aspect, 0.1);
    double widest = 0, highest = 0;
    for (const Vec3& x : points) {
      const Eigen::Vector2d p = project(camera, x, 1000, 1000);
      widest = std::max(widest, std::abs(p.x() - 500.0) / (500.0 * aspect));
      highest = std::max(highest, std::abs(p.y() - 500.0) / 500.0);
    }
    EXPECT_LE(std::max(widest, highest), 0.9 + 1e-9);
    EXPECT_NEAR(std::max(widest, highest), 0.9, 1e-9) << "not as near as it could be";
  }
}

TEST(Camera, AspectIsTheNarrowestThatCostsNoDistance) {
  // seen along y: 0.3 wide, 0.2 high, all at one depth
  const std::vector<Vec3> points{{-0.1, 0, 0}, {0.2, 0, 0.1}, {0.05, 0, 0.2}};
  EXPECT_NEAR(fitAspect(points, {0, 1, 0}, 0.5, 0.5, 2.0, 0.1), 1.5, 1e-5);
  EXPECT_NEAR(fitAspect(points, {0, 1, 0}, 0.5, 0.5, 1.2, 0.1), 1.2, 1e-5);
  EXPECT_NEAR(fitAspect(points, {0, 1, 0}, 0.5, 1.7, 2.0, 0.1), 1.7, 1e-5);
}

TEST(Camera, GridSpacingIsARoundNumber) {
  EXPECT_DOUBLE_EQ(gridSpacing(0.2), 0.02);
  EXPECT_DOUBLE_EQ(gridSpacing(0.3), 0.05);
  EXPECT_DOUBLE_EQ(gridSpacing(5.5), 1.0);
  EXPECT_EQ(gridSpacing(0.0), 0.0);
}

TEST(Shapes, HaveTheirVolume) {
  const double pi = std::numbers::pi, r = 0.2;
  EXPECT_NEAR(volume(capsuleMesh({1, 2, 3}, {1, 2, 3}, r, kRed)), 4.0 / 3.0 * pi * r * r * r, 0.05 * r * r * r);
  EXPECT_NEAR(volume(capsuleMesh({1, 2, 3}, {1, 2.5, 3}, r, kRed)), pi * r * r * (4.0 / 3.0 * r + 0.5), 0.02 * r * r);
  Pose pose;
  pose.position = {1, 0, -1};
  pose.rotation = Quat(Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized()));
  EXPECT_NEAR(volume(boxMesh(pose, {0.1, 0.2, 0.3}, kRed)), 8 * 0.1 * 0.2 * 0.3, 1e-12);
  EXPECT_GT(volume(arrowMesh({0, 0, 0}, {0, 1, 0}, 0.1, kRed)), 0.0);
  EXPECT_GT(volume(penMesh({0, 0, 0}, {0, 1, 0}, 0.1, kRed)), 0.0);
  EXPECT_TRUE(arrowMesh({1, 1, 1}, {1, 1, 1}, 0.1, kRed).triangles.empty());
}

TEST(Shapes, CutOpenKeepsOneSideAndCutsAtThePlane) {
  const PictureMesh box = boxMesh(Pose{}, {0.1, 0.2, 0.3}, kRed);
  const Vec3 point(0.03, 0, 0);
  const auto area = [](const PictureMesh& mesh) {
    double sum = 0;
    for (const auto& [a, b, c] : mesh.triangles) {
      sum += 0.5 * (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm();
    }
    return sum;
  };
  const PictureMesh cut = cutOpen(box, point, Vec3::UnitX());
  double lowest = 1;
  for (const auto& triangle : cut.triangles) {
    for (const int v : triangle) lowest = std::min(lowest, cut.vertices[v].x());
  }
  EXPECT_NEAR(lowest, 0.03, 1e-12);
  EXPECT_NEAR(area(cut), 0.4 * 0.6 + 0.07 * 2 * (0.4 + 0.6), 1e-12);  // one end and a part of the sides, no lid
  EXPECT_NEAR(area(cut) + area(cutOpen(box, point, -Vec3::UnitX())), area(box), 1e-12);
  EXPECT_TRUE(cutOpen(box, {1, 0, 0}, Vec3::UnitX()).triangles.empty());
}

TEST(Render, InsideIsDarkerWhereAsked) {
  PictureScene scene = ballOnGround();
  scene.meshes = {cutOpen(scene.meshes[0], scene.focus, scene.camera.direction)};  // looks into a bowl
  const auto whole = render(scene, 40, 40), again = render(scene, 40, 40);
  scene.meshes[0].inside = 0.5F;
  const auto darker = render(scene, 40, 40);
  EXPECT_EQ(whole.rgb, again.rgb);
  const std::size_t red = 3 * (20 * 40 + 20);
  EXPECT_LT(darker.rgb[red], whole.rgb[red] - 20);
}

TEST(SmoothMesh, BallIsSmoothAndBoxKeepsItsEdges) {
  const SmoothMesh ball = smoothMesh(capsuleMesh({1, 0, 0}, {1, 0, 0}, 0.5, kRed), {1, 0, 0});
  ASSERT_FALSE(ball.normals.empty());
  for (std::size_t i = 0; i < ball.normals.size(); ++i) {
    EXPECT_GT(ball.normals[i].dot(ball.positions[i]) / 0.5F, 0.98F);
  }
  PictureMesh cube;  // eight shared corners
  cube.colors = {kRed};
  for (int i = 0; i < 8; ++i) cube.vertices.emplace_back(i & 1, (i >> 1) & 1, i >> 2);
  cube.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                    {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  SmoothMesh sharp = smoothMesh(cube, Vec3::Zero());
  refine(sharp, 0.3, 100000);
  EXPECT_EQ(sharp.triangles.size(), 12U * 16U);
  for (const Eigen::Vector3f& n : sharp.normals) EXPECT_NEAR(n.cwiseAbs().maxCoeff(), 1.0F, 1e-6F);
}

TEST(Render, IsTheSameTwice) {
  const PictureScene scene = ballOnGround();
  EXPECT_EQ(render(scene, 80, 60).rgb, render(scene, 80, 60).rgb);
}

TEST(Render, BallIsWhereTheCameraSeesIt) {
  const PictureScene scene = ballOnGround();
  constexpr int kSize = 160;
  const Bitmap image = render(scene, kSize, kSize);
  int inside = 0, wrong = 0;
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      // distance of the line of sight from the center
      const CameraFrame frame = cameraFrame(scene.camera.direction);
      const double focal = 0.5 * kSize / std::tan(0.5 * scene.camera.field_of_view);
      const Vec3 sight =
          (frame.forward + (x + 0.5 - 0.5 * kSize) / focal * frame.right - (y + 0.5 - 0.5 * kSize) / focal * frame.up)
              .normalized();
      const double distance = (scene.focus - scene.camera.eye).cross(sight).norm();
      if (std::abs(distance - 0.1) < 0.003) continue;  // the edge
      inside += distance < 0.1 ? 1 : 0;
      if (isRed(at(image, x, y)) != (distance < 0.1)) ++wrong;
    }
  }
  EXPECT_GT(inside, 3000);
  EXPECT_EQ(wrong, 0);
}

TEST(Render, NearerHidesFartherInAnyOrder) {
  PictureScene scene = ballOnGround();
  const CameraFrame frame = cameraFrame(scene.camera.direction);
  const Vec3 near = scene.focus - 0.2 * frame.forward, far = scene.focus + 0.5 * frame.forward;
  const PictureMesh front = capsuleMesh(near, near, 0.02, kBlue), back = capsuleMesh(far, far, 0.02, kBlue);
  for (const bool first : {false, true}) {
    scene.meshes = {first ? front : ballOnGround().meshes[0], first ? ballOnGround().meshes[0] : front};
    EXPECT_TRUE(isBlue(at(render(scene, 80, 80), 40, 40)));
    scene.meshes = {first ? back : ballOnGround().meshes[0], first ? ballOnGround().meshes[0] : back};
    EXPECT_TRUE(isRed(at(render(scene, 80, 80), 40, 40)));
  }
  scene.meshes = {back, ballOnGround().meshes[0]};
  scene.meshes[0].on_top = true;
  EXPECT_TRUE(isBlue(at(render(scene, 80, 80), 40, 40)));
}

TEST(Render, BallShadowsTheGroundAwayFromTheLamp) {
  PictureScene scene = ballOnGround();
  constexpr int kSize = 200;
  const Bitmap with = render(scene, kSize, kSize);
  scene.meshes.clear();
  const Bitmap without = render(scene, kSize, kSize);
  // the lamp is on the left and in front: the shadow falls to the right and back
  const CameraFrame frame = cameraFrame(scene.camera.direction);
  const auto brightness = [&](const Bitmap& image, const Vec3& x) {
    const Eigen::Vector2d p = project(scene.camera, x, kSize, kSize);
    return at(image, static_cast<int>(p.x()), static_cast<int>(p.y())).g;
  };
  const Vec3 shadow = 0.125 * frame.right, lit = -0.16 * frame.right;
  EXPECT_LT(brightness(with, shadow), brightness(without, shadow) - 40);
  EXPECT_GT(brightness(with, lit), brightness(without, lit) - 25);
  EXPECT_GT(brightness(without, shadow), 235);
}

TEST(Render, GroundHidesWhatIsBelowIt) {
  PictureScene scene = ballOnGround();
  scene.planes[0].point = {0, 0, 0.3};
  scene.camera.eye = {0, -1, 1};
  scene.camera.direction = Vec3(0, 1, -0.9).normalized();
  const Bitmap image = render(scene, 60, 60);
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 60; ++x) ASSERT_FALSE(isRed(at(image, x, y)));
  }
}

TEST(Render, FloorThatPassesBehindTheCameraIsClipped) {
  PictureScene scene;
  // many small triangles far below keep the large one from being divided
  PictureMesh floor = capsuleMesh({0, 0, -9}, {0, 0, -9}, 0.01, kBlue);
  const int n = static_cast<int>(floor.vertices.size());
  floor.vertices.insert(floor.vertices.end(), {{-50, -50, 0}, {50, -50, 0}, {0, 50, 0}});
  floor.triangles.push_back({n, n + 1, n + 2});
  scene.meshes = {floor};
  scene.camera.eye = {0, 0, 1};
  scene.camera.direction = Vec3(0, 1, -0.1).normalized();
  scene.radius = 10;
  const Bitmap image = render(scene, 60, 60);
  EXPECT_TRUE(isBlue(at(image, 30, 50)));
  EXPECT_TRUE(isBlue(at(image, 30, 59)));
  EXPECT_FALSE(isBlue(at(image, 30, 2)));
}

TEST(Render, SurvivesDegenerateGeometryAndRefusesWrongIndices) {
  PictureScene scene = ballOnGround();
  scene.meshes.push_back({{{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}, {{0, 1, 2}, {0, 0, 1}}, {kRed}, 0.1F, false});
  const double nan = std::nan("");
  scene.meshes.push_back({{{nan, 0, 0}, {0, nan, 0}, {0, 0, 1}}, {{0, 1, 2}}, {kRed}, 0.1F, false});
  EXPECT_TRUE(isRed(at(render(scene, 40, 40), 20, 20)));
  scene.meshes.back().triangles = {{0, 1, 3}};
  EXPECT_THROW(render(scene, 40, 40), std::logic_error);
  scene.meshes.back() = ballOnGround().meshes[0];
  scene.meshes.back().colors.clear();
  EXPECT_THROW(render(scene, 40, 40), std::logic_error);
  EXPECT_THROW(render(ballOnGround(), 0, 40), std::logic_error);
}

TEST(Png, HoldsEveryPixelOfThePicture) {
  const Bitmap picture = render(ballOnGround(), 70, 50);
  const Bitmap read = testing::decodePng(encodePng(picture));
  EXPECT_EQ(read.width, 70);
  EXPECT_EQ(read.height, 50);
  EXPECT_EQ(read.rgb, picture.rgb);
  EXPECT_TRUE(isRed(at(read, 35, 25)));  // the ball is in the middle
  EXPECT_FALSE(isRed(at(read, 0, 0)));
}

TEST(Png, SheetPlacesPicturesInRows) {
  std::vector<Bitmap> parts;
  for (int i = 0; i < 3; ++i)
    parts.push_back({2, 1, std::vector<unsigned char>(6, static_cast<unsigned char>(10 * i))});
  const Bitmap all = sheet(parts, 2, 1);
  ASSERT_EQ(all.width, 5);
  ASSERT_EQ(all.height, 3);
  EXPECT_EQ(at(all, 1, 0).r, 0);
  EXPECT_EQ(at(all, 2, 0).r, 255);
  EXPECT_EQ(at(all, 3, 0).r, 10);
  EXPECT_EQ(at(all, 0, 1).r, 255);
  EXPECT_EQ(at(all, 0, 2).r, 20);
  EXPECT_EQ(at(all, 4, 2).r, 255);
}

}  // namespace
}  // namespace palpate
