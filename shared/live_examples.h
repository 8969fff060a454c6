#pragma once

#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "palpate/live/live_model.h"
#include "palpate/math/decompositions.h"

namespace palpate::test {

/// A rigid tool: no modes, no contacts.
inline LiveModel rigidTool(double mass = 0.2) {
  LiveModel m;
  m.index = 0;
  m.mass = mass;
  m.inertia.setZero();
  m.inertia.topLeftCorner<3, 3>() = mass * Mat3::Identity();
  m.inertia.bottomRightCorner<3, 3>() = Vec3(2e-4, 3e-4, 4e-4).asDiagonal();
  m.coupling.resize(6, 0);
  m.centrifugal.resize(0, 6);
  for (int k = 0; k < 3; ++k) {
    m.coriolis[k].resize(0, 0);
    m.coriolis_torque[k].resize(3, 0);
  }
  m.shape.resize(0, 0);
  m.squared_frequency.resize(0);
  m.force.resize(0);
  m.speed.resize(0);
  m.arm.resize(0);
  m.compliance.resize(0, 0);
  m.tool_compliance.resize(0, 0);
  m.damped_force.resize(0);
  m.contact_force.resize(0);
  m.curvature.resize(0, 0);
  return m;
}

/// Made of point masses on springs to the handle, so that every array follows from one set of shapes: `points` of them,
/// as many modes, and a contact with a plane under each of the first ones.
inline LiveModel softTool(int points, int modes, int contacts, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> u(-1, 1);
  const auto vec = [&](double s) { return Vec3(s * u(random), s * u(random), s * u(random)); };
  LiveModel m = rigidTool(0.05);
  m.beta = 0.002;
  const double mass = 0.01;
  MatX q(3 * points, modes);
  for (Eigen::Index i = 0; i < q.rows(); ++i)
    for (Eigen::Index j = 0; j < modes; ++j) q(i, j) = u(random);
  // orthonormal, then by the mass
  const MatX gram = q.transpose() * q;
  const SymmetricEigen eigen = symmetricEigen(gram);
  q = q * eigen.vectors * (mass * eigen.values).cwiseSqrt().cwiseInverse().asDiagonal();
  m.squared_frequency.resize(modes);
  m.force.setZero(modes);
  m.speed.setZero(modes);
  for (int j = 0; j < modes; ++j) m.squared_frequency[j] = 2e3 * (1 + j) * (1 + j);
  m.damping = m.beta * m.squared_frequency;
  m.coupling.setZero(6, modes);
  m.centrifugal.setZero(modes, 6);
  for (int k = 0; k < 3; ++k) {
    m.coriolis[k].setZero(modes, modes);
    m.coriolis_torque[k].setZero(3, modes);
  }
  const auto cross = [](const Vec3& a) {
    Mat3 s;
    s << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
    return s;
  };
  std::vector<Vec3> places;
  for (int i = 0; i < points; ++i) {
    const Vec3 y = vec(0.03) - Vec3(0, 0, 0.04);
    places.push_back(y);
    const auto qi = q.middleRows<3>(3 * i);
    m.mass += mass;
    m.moment += mass * y;
    Eigen::Matrix<double, 3, 6> g;
    g << Mat3::Identity(), -cross(y);
    m.inertia += mass * g.transpose() * g;
    m.coupling += mass * g.transpose() * qi;
    for (int k = 0; k < 3; ++k) {
      const Mat3 axis = cross(Vec3::Unit(k));
      m.coriolis[k] += mass * qi.transpose() * axis * qi;
      m.coriolis_torque[k] += mass * cross(y) * axis * qi;
    }
    const auto twice = [&](int a, int b) {
      const Mat3 sum = cross(Vec3::Unit(a)) * cross(Vec3::Unit(b)) + cross(Vec3::Unit(b)) * cross(Vec3::Unit(a));
      return Vec3((a == b ? 0.5 : 1.0) * mass * sum * y);
    };
    int c = 0;
    for (const auto& [a, b] : {std::pair{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}})
      m.centrifugal.col(c++) += qi.transpose() * twice(a, b);
  }
  m.contacts = contacts;
  m.arm.resize(3 * contacts);
  m.shape.resize(3 * contacts, modes);
  m.compliance = 1e-4 * MatX::Identity(3 * contacts, 3 * contacts);
  m.damped_force.setZero(3 * contacts);
  m.contact_force.setZero(3 * contacts);
  m.curvature.resize(3 * contacts, 0);
  for (int i = 0; i < contacts; ++i) {
    m.arm.segment<3>(3 * i) = places[static_cast<std::size_t>(i)];
    m.shape.middleRows<3>(3 * i) = q.middleRows<3>(3 * i);
    m.surface[i].normal = Vec3::UnitZ();
    m.surface[i].a = Vec3(0, 0, -0.09);
    m.friction[i] = 0.5;
  }
  m.tool_compliance = m.compliance;
  return m;
}

}  // namespace palpate::test
