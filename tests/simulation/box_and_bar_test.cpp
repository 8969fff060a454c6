#include <gtest/gtest.h>

#include "palpate/mesh/embed_surface.h"
#include "shared/held_scenes.h"

// One block as a regular bar, as a box of twelve triangles, and as a CAD program might tessellate it: contact must not
// depend on the triangles.

namespace palpate::test {
namespace {

const Vec3 kSize(0.08, 0.08, 0.06);  // [m]

Material materialOf(double youngs_modulus) {
  Material m;
  m.youngs_modulus = youngs_modulus;
  m.poisson_ratio = 0.3;
  m.density = 1000;
  return m;
}

// Each face as a fan about one point near its edge: long, slender triangles.
Surface fans() {
  Surface out;
  const Vec3 half = 0.5 * kSize;
  for (int d = 0; d < 3; ++d) {
    for (const double side : {-1.0, 1.0}) {
      const Vec3 u = Vec3::Unit((d + 1) % 3), v = Vec3::Unit((d + 2) % 3), n = side * Vec3::Unit(d);
      const auto at = [&](double a, double b) -> Vec3 { return (n + a * u + b * v).cwiseProduct(half); };
      const int center = static_cast<int>(out.vertices.size());
      out.vertices.push_back(at(0.8, 0.3));
      constexpr int kPerSide = 4;
      for (int k = 0; k < 4 * kPerSide; ++k) {
        const double s = 2.0 * (k % kPerSide) / kPerSide - 1;
        const int edge = k / kPerSide;
        out.vertices.push_back(edge == 0 ? at(s, -1) : edge == 1 ? at(1, s) : edge == 2 ? at(-s, 1) : at(-1, -s));
      }
      for (int k = 0; k < 4 * kPerSide; ++k) {
        const int a = center + 1 + k, b = center + 1 + (k + 1) % (4 * kPerSide);
        if (side > 0) {
          out.triangles.push_back({center, a, b});
        } else {
          out.triangles.push_back({center, b, a});
        }
      }
    }
  }
  return out;
}

SimulationMesh blockOf(int kind) {
  if (kind == 0) {
    return moved(barMesh(kSize, {7, 7, 5}), Pose{Vec3(-0.5 * kSize.x(), -0.5 * kSize.y(), 0.0), Quat::Identity()});
  }
  EmbedOptions options;
  options.target_tetrahedra = 1500;
  return moved(embedSurface(kind == 1 ? boxSurface(kSize) : fans(), options),
               Pose{Vec3(0, 0, 0.5 * kSize.z()), Quat::Identity()});
}

struct Lying {
  double sag = 0;     // of the top [m]
  double lowest = 0;  // of the whole surface, below the ground [m]
  int inverted = 0;   // tetrahedra
  int contacts = 0, nodes = 0;
};

Lying lyingOnTheGround(int kind, double youngs_modulus) {
  World world;
  world.gravity = Vec3(0, 0, -9.81);
  world.contact.thickness = 2e-4;
  world.obstacles.push_back(ground());
  const SimulationMesh mesh = blockOf(kind);
  world.add(BodyModel("block", mesh, materialOf(youngs_modulus)));
  world.settle({0}, Pose{});
  const Body body = world.body(0);
  Lying out;
  int tops = 0;
  for (std::size_t v = 0; v < mesh.embedding.size(); ++v) {
    const EmbeddedPoint& e = mesh.embedding[v];
    Vec3 p = Vec3::Zero();
    for (int k = 0; k < 4; ++k)
      p += e.weights[k] * body.state.positions.segment<3>(3 * mesh.mesh.tetrahedra[e.tetrahedron][k]);
    out.lowest = std::max(out.lowest, -p.z());
    if (mesh.surface.vertices[v].z() < kSize.z() * (1 - 1e-6)) continue;
    out.sag += kSize.z() - p.z();
    ++tops;
  }
  out.sag /= tops;
  for (const ElasticElement& e : body.model.elasticity().elements()) {
    out.inverted += e.deformationGradient(body.state.positions).determinant() <= 0;
  }
  out.contacts = static_cast<int>(world.contacts().contacts.size());
  for (const Vec3& x : mesh.mesh.nodes) out.nodes += x.z() < 0.3 * kSize.z();
  return out;
}

TEST(BoxAndBar, SagAlikeUnderTheirWeight) {
  for (const double youngs_modulus : {1e4, 1e5, 1e6}) {
    const Lying bar = lyingOnTheGround(0, youngs_modulus);
    for (const int kind : {1, 2}) {
      const Lying other = lyingOnTheGround(kind, youngs_modulus);
      EXPECT_NEAR(other.sag / bar.sag, 1, 0.1)
          << kind << " at " << youngs_modulus << " Pa: " << other.sag << " " << bar.sag;
      EXPECT_EQ(other.inverted, 0);
      EXPECT_LT(other.lowest, 2e-4);
      EXPECT_LE(other.contacts, other.nodes) << kind;
    }
  }
}

// A stiff punch of 2 cm presses the middle of the top, where the box has no vertex of its own.
TEST(BoxAndBar, FeelAlikeUnderAPunch) {
  for (const double youngs_modulus : {1e4, 1e5}) {
    double force[3];
    for (const int kind : {0, 1, 2}) {
      World world;
      world.gravity.setZero();
      world.contact.thickness = 2e-4;
      world.obstacles.push_back(ground());
      world.link.stiffness = 1e5;
      world.link.rotational_stiffness = 1e3;
      BodyModel punch(
          "punch",
          moved(barMesh(Vec3(0.02, 0.02, 0.02), {2, 2, 2}), Pose{Vec3(-0.01, -0.01, 0.0604), Quat::Identity()}),
          materialOf(1e7));
      holdNodes(
          punch, [](const Vec3& x) { return x.z() > 0.0804 - 1e-9; }, kPlainHandle);
      world.add(std::move(punch));
      world.add(BodyModel("block", blockOf(kind), materialOf(youngs_modulus)));
      Pose device = world.tool().state.handle.pose;
      const double top = device.position.z();
      for (int k = 0; k < 60; ++k) {
        device.position.z() = top - 0.0044 * std::min(1.0, k / 20.0);
        ASSERT_FALSE(world.step({device, Vec6::Zero()}, 0.033).failed());
      }
      force[kind] = contactForce(world, world.toolIndex()).total.z();
    }
    EXPECT_GT(force[0], 0);
    // under a punch of two cells the lattices themselves differ by a tenth; on its corners alone the box gave nothing
    EXPECT_NEAR(force[1] / force[0], 1, 0.15) << youngs_modulus;
    EXPECT_NEAR(force[2] / force[0], 1, 0.15) << youngs_modulus;
  }
}

}  // namespace
}  // namespace palpate::test
