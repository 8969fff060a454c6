// Bars that the world holds by their ends, against the theory of beams.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "shared/attached_bodies.h"

namespace palpate {
namespace {

using namespace test;

/// Deflection of the nodes near x under the bar's own weight; second order in the cells' size, so two sizes tell where
/// they lead.
template <class Region>
double deflection(const Vec3& size, double e, double x, const Region& held) {
  std::array<double, 2> found{};
  for (int fine = 0; fine < 2; ++fine) {
    const int n = fine == 0 ? 3 : 6;
    BodyModel body("bar", barMesh(size, {10 * n, n, n}), material(e));
    body.attach(fixed(body, held));
    World world = alone(std::move(body));
    world.settle({0}, {});
    const auto nodes =
        nodesWhere(world.body(0).model.mesh().mesh.nodes, [&](const Vec3& p) { return std::abs(p.x() - x) < 1e-9; });
    found[static_cast<std::size_t>(fine)] = -meanHeight(world.body(0), nodes);
  }
  return found[1] + (found[1] - found[0]) / 3;
}

// Timoshenko's beam: q L^4 / (8 E I) + q L^2 / (2 k G A), and q L^4 / (384 E I) + q L^2 / (8 k G A) between two walls.
TEST(Beam, BendsAsInTheory) {
  const Vec3 size(0.2, 0.02, 0.02);
  const double area = size.y() * size.z(), inertia = area * size.z() * size.z() / 12, length = size.x();
  const double q = 1000 * kDown * area, shape = 5.0 / 6.0;
  {
    const double e = 3e7;
    const double theory = q * std::pow(length, 4) / (8 * e * inertia) + q * length * length / (shape * e * area);
    EXPECT_NEAR(deflection(size, e, length, [](const Vec3& x) { return x.x() < 1e-9; }), theory, 0.03 * theory);
  }
  const double e = 3e6;
  const double theory = q * std::pow(length, 4) / (384 * e * inertia) + q * length * length / (4 * shape * e * area);
  const auto ends = [&](const Vec3& x) { return x.x() < 1e-9 || x.x() > length - 1e-9; };
  EXPECT_NEAR(deflection(size, e, 0.5 * length, ends), theory, 0.05 * theory);
}

}  // namespace
}  // namespace palpate
