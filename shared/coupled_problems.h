#pragma once

// Contact problems with the bodies that they come from, soft and rigid, whose contacts act on one another: stacks,
// a chain, wedges.

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "shared/contact_problems.h"

namespace palpate::test {

/// A contact problem with the bodies that it was condensed from: W = J A^-1 J^T, free = J velocity.
struct CoupledProblem : OwnedProblem {
  MatX system;    ///< A, block diagonal [kg]
  MatX jacobian;  ///< J, 3m x freedoms
  VecX velocity;  ///< without contact [m/s]
  VecX momentum;  ///< A velocity [N s]
};

/// A box of nodes joined by springs to all 26 neighbors, one implicit step ahead. Node (x, y, z) is at corner +
/// spacing (x, y, z).
struct Lattice {
  int nx = 3, ny = 3, nz = 3;
  double spacing = 0.02;    ///< [m]
  double mass = 0.05;       ///< of the whole [kg]
  double stiffness = 60.0;  ///< of one spring [N/m]
  double step = 0.02;       ///< [s]
  int node(int x, int y, int z) const { return (z * ny + y) * nx + x; }
  int nodes() const { return nx * ny * nz; }
  MatX system() const {
    const int n = nodes();
    MatX a = MatX::Zero(3 * n, 3 * n);
    a.diagonal().setConstant(mass / n);
    const double factor = step * step * stiffness + 0.005 * step * stiffness;
    for (int z = 0; z < nz; ++z)
      for (int y = 0; y < ny; ++y)
        for (int x = 0; x < nx; ++x)
          for (int k = 14; k < 27; ++k) {
            const int u = x + k % 3 - 1, v = y + k / 3 % 3 - 1, w = z + k / 9 - 1;
            if (u < 0 || v < 0 || w < 0 || u >= nx || v >= ny || w >= nz) continue;
            const Vec3 d(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
            const int i = 3 * node(x, y, z), j = 3 * node(u, v, w);
            const Mat3 block = factor * (d * d.transpose() / d.squaredNorm() + 0.05 * Mat3::Identity());
            a.block<3, 3>(i, i) += block;
            a.block<3, 3>(j, j) += block;
            a.block<3, 3>(i, j) -= block;
            a.block<3, 3>(j, i) -= block;
          }
    return a;
  }
};

/// Bodies, soft or rigid, and contacts between them; a contact's second body may be none (fixed ground).
class Assembly {
 public:
  /// A point of a body: how it moves with the body's freedoms (3 x freedoms). No body: fixed.
  struct Point {
    int body = -1;
    MatX moves;
  };

  int addSoft(const Lattice& lattice, const Vec3& velocity) {
    return add(lattice.system(), velocity.replicate(lattice.nodes(), 1));
  }
  /// A box about its center; freedoms are velocity and angular velocity.
  int addRigid(double mass, const Vec3& size, const Vec3& velocity) {
    MatX a = MatX::Zero(6, 6);
    a.diagonal().head<3>().setConstant(mass);
    for (int k = 0; k < 3; ++k) a(3 + k, 3 + k) = mass / 12 * (size.squaredNorm() - size[k] * size[k]);
    VecX v = VecX::Zero(6);
    v.head<3>() = velocity;
    return add(std::move(a), std::move(v));
  }
  /// Where the lattice face of height z (a node index) has the coordinates x, y in units of the spacing.
  Point onFace(int body, const Lattice& l, double x, double y, int z) const {
    const int u = std::min(static_cast<int>(x), l.nx - 2), v = std::min(static_cast<int>(y), l.ny - 2);
    const double a = x - u, b = y - v;
    Point p = still(body);
    const auto put = [&](int du, int dv, double weight) {
      p.moves.block<3, 3>(0, 3 * l.node(u + du, v + dv, z)).diagonal().array() += weight;
    };
    // either triangle of the cell
    put(0, 0, 1.0 - std::max(a, b));
    if (a > b) {
      put(1, 0, a - b);
    } else {
      put(0, 1, b - a);
    }
    put(1, 1, std::min(a, b));
    return p;
  }
  Point onNode(int body, int node) const {
    Point p = still(body);
    p.moves.block<3, 3>(0, 3 * node).setIdentity();
    return p;
  }
  /// @param arm  from the center of a rigid body
  Point onRigid(int body, const Vec3& arm) const {
    Point p = still(body);
    p.moves.leftCols<3>().setIdentity();
    p.moves.rightCols<3>() << 0, arm[2], -arm[1], -arm[2], 0, arm[0], arm[1], -arm[0], 0;
    return p;
  }
  /// @param normal  from second towards first, unit length
  /// @param bias    least normal velocity, -gap / step [m/s]
  void addContact(Point first, Point second, const Vec3& normal, double bias, double mu) {
    contacts_.push_back({std::move(first), std::move(second), normal, bias, mu});
  }
  int contacts() const { return static_cast<int>(contacts_.size()); }

  CoupledProblem make(const FrictionCone& cone) const {
    CoupledProblem p;
    p.cone = cone;
    const int m = contacts(), n = freedoms_;
    p.system = MatX::Zero(n, n);
    p.velocity.resize(n);
    p.jacobian = MatX::Zero(3 * m, n);
    p.bias.resize(m);
    p.friction.resize(m);
    for (int i = 0; i < m; ++i) {
      const Contact& c = contacts_[i];
      const Vec3 other = std::abs(c.normal[0]) < 0.9 ? Vec3::UnitX() : Vec3::UnitY();
      const Vec3 t = (other - other.dot(c.normal) * c.normal).normalized();
      Mat3 frame;
      frame << c.normal.transpose(), t.transpose(), c.normal.cross(t).transpose();
      for (const auto& [point, sign] : {std::pair(&c.first, 1.0), std::pair(&c.second, -1.0)}) {
        if (point->body < 0) continue;
        p.jacobian.block(3 * i, bodies_[point->body].first, 3, point->moves.cols()) += sign * frame * point->moves;
      }
      p.bias[i] = c.bias;
      p.friction[i] = c.mu;
    }
    p.delassus = MatX::Zero(3 * m, 3 * m);
    for (const Body& b : bodies_) {
      const Eigen::Index size = b.velocity.size();
      p.system.block(b.first, b.first, size, size) = b.system;
      p.velocity.segment(b.first, size) = b.velocity;
      addCompliance(p.jacobian.middleCols(b.first, size), b.system, p.delassus);
    }
    p.momentum = p.system * p.velocity;
    p.free = p.jacobian * p.velocity;
    return p;
  }

 private:
  struct Body {
    MatX system;
    VecX velocity;
    int first;
  };
  struct Contact {
    Point first, second;
    Vec3 normal;
    double bias, mu;
  };

  int add(MatX system, VecX velocity) {
    const int first = freedoms_;
    freedoms_ += static_cast<int>(velocity.size());
    bodies_.push_back({std::move(system), std::move(velocity), first});
    return static_cast<int>(bodies_.size()) - 1;
  }
  Point still(int body) const { return {body, MatX::Zero(3, bodies_[body].velocity.size())}; }

  /// Adds J A^-1 J^T of one body's columns, over the rows that touch it only: the zeros stay zero.
  static void addCompliance(const MatX& columns, const MatX& system, MatX& delassus) {
    std::vector<int> rows;
    for (int i = 0; i < columns.rows(); i += 3)
      if (!columns.middleRows<3>(i).isZero(0.0)) rows.insert(rows.end(), {i, i + 1, i + 2});
    const Eigen::LLT<MatX> factorized(system);
    const MatX half = factorized.matrixL().solve(MatX(columns(rows, Eigen::all)).transpose());
    delassus(rows, rows) += half.transpose() * half;
  }

  std::vector<Body> bodies_;
  std::vector<Contact> contacts_;
  int freedoms_ = 0;
};

/// Problems of coupled bodies, each with a number of contacts to choose.
enum class Coupling {
  uneven,          ///< a soft body dragged over another, gaps of 0.1 mm up and down
  flat,            ///< the same with faces exactly flat: with more points than nodes, redundant
  heavy_on_light,  ///< five soft bodies, flat faces; the topmost weighs 100 times the others and is pushed aside
  light_on_heavy,  ///< the lowest weighs 100 times the others
  alternating,     ///< heavy and light in turn, 1:100
  rigid_stack,     ///< five rigid boxes, alternating 1:100: as redundant as can be
  chain,           ///< a row of five soft bodies on the ground pushed from one end, 1:100 in turn
  wedge,           ///< a soft plug pressed between two fixed walls that close at 10 degrees a side
  rigid_wedge,     ///< a rigid one
  piles            ///< ten separate stacks of two soft bodies on the ground
};

inline const std::vector<std::pair<Coupling, const char*>>& allCouplings() {
  static const std::vector<std::pair<Coupling, const char*>> all = {{Coupling::uneven, "uneven"},
                                                                    {Coupling::flat, "flat"},
                                                                    {Coupling::heavy_on_light, "heavy_on_light"},
                                                                    {Coupling::light_on_heavy, "light_on_heavy"},
                                                                    {Coupling::alternating, "alternating"},
                                                                    {Coupling::rigid_stack, "rigid_stack"},
                                                                    {Coupling::chain, "chain"},
                                                                    {Coupling::wedge, "wedge"},
                                                                    {Coupling::rigid_wedge, "rigid_wedge"},
                                                                    {Coupling::piles, "piles"}};
  return all;
}

/// Makes them. Gravity, 20 ms steps from rest, plus `drag` where bodies are pushed or dragged.
struct CoupledScene {
  Coupling kind = Coupling::flat;
  int contacts = 100;
  double mu = 0.5;
  unsigned seed = 1;
  double drag = 0.3;   ///< [m/s]
  double press = 0.2;  ///< weight's velocity in a step [m/s]
  int face = 0;        ///< nodes along an edge of a face; 0: by the number of contacts

  CoupledProblem make(const FrictionCone& cone) const {
    Builder b{*this};
    switch (kind) {
      case Coupling::uneven:
      case Coupling::flat:
        b.faces(kind == Coupling::flat ? 0.0 : 1e-4);
        break;
      case Coupling::chain:
        b.chain();
        break;
      case Coupling::wedge:
        b.wedge();
        break;
      case Coupling::rigid_wedge:
        b.rigidWedge();
        break;
      case Coupling::rigid_stack:
        b.rigidStack();
        break;
      case Coupling::piles:
        for (int k = 0; k < 10; ++k) b.stack({1.0, 1.0}, contacts / 20 + (k < contacts % 20 / 2 ? 1 : 0));
        break;
      default:
        b.stack(ratios(), contacts / 5);
    }
    return b.assembly.make(cone);
  }

  std::vector<double> ratios() const {
    if (kind == Coupling::heavy_on_light) return {1, 1, 1, 1, 100};
    if (kind == Coupling::light_on_heavy) return {100, 1, 1, 1, 1};
    return {1, 100, 1, 100, 1};
  }

 private:
  struct Builder {
    const CoupledScene& scene;
    Assembly assembly = {};
    std::mt19937 random{scene.seed};
    std::uniform_real_distribution<double> uniform = {};
    std::normal_distribution<double> normal = {};

    int edge(int points) const {
      if (scene.face > 0) return scene.face;
      return std::clamp(static_cast<int>(std::ceil(std::sqrt(0.3 * points))) + 1, 3, 12);
    }
    Lattice lattice(int points, double ratio) const {
      Lattice l;
      l.nx = l.ny = edge(points);
      l.nz = 3;
      l.mass = 1e-3 * ratio * l.nodes();
      l.stiffness *= ratio;
      return l;
    }
    Vec3 falling(double side) const { return {side, 0.3 * side, -scene.press}; }

    /// Points spread over the faces of two like lattices that meet (or of one and the ground).
    void meet(int above, const Lattice& a, int below, int points, double bumps) {
      for (int i = 0; i < points; ++i) {
        const double x = uniform(random) * (a.nx - 1), y = uniform(random) * (a.ny - 1);
        const auto lower = below < 0 ? Assembly::Point{} : assembly.onFace(below, a, x, y, a.nz - 1);
        assembly.addContact(assembly.onFace(above, a, x, y, 0), lower, Vec3::UnitZ(), bumps / a.step * normal(random),
                            scene.mu);
      }
    }
    void faces(double bumps) {
      const int ground = std::max(3, scene.contacts / 5), between = scene.contacts - ground;
      const Lattice l = lattice(between, 1.0);
      const int low = assembly.addSoft(l, falling(0.0)), high = assembly.addSoft(l, falling(scene.drag));
      meet(low, l, -1, ground, bumps);
      meet(high, l, low, between, bumps);
    }
    void stack(const std::vector<double>& masses, int points) {
      int below = -1;
      for (const double ratio : masses) {
        const Lattice l = lattice(points, ratio);
        const bool top = &ratio == &masses.back();
        const int body = assembly.addSoft(l, falling(top ? 0.1 * scene.drag : 0.0));
        meet(body, l, below, std::max(points, 1), 0.0);
        below = body;
      }
    }
    void rigidStack() {
      int below = -1;
      const Vec3 size(0.1, 0.1, 0.1);
      for (int level = 0; level < 5; ++level) {
        const int body = assembly.addRigid(level % 2 == 0 ? 0.1 : 10.0, size, falling(level == 4 ? scene.drag : 0.0));
        for (int i = 0; i < scene.contacts / 5; ++i) {
          const double x = size[0] * (uniform(random) - 0.5), y = size[1] * (uniform(random) - 0.5);
          const auto lower = below < 0 ? Assembly::Point{} : assembly.onRigid(below, {x, y, 0.5 * size[2]});
          assembly.addContact(assembly.onRigid(body, {x, y, -0.5 * size[2]}), lower, Vec3::UnitZ(), 0.0, scene.mu);
        }
        below = body;
      }
    }
    void chain() {
      const int each = scene.contacts / 10;
      int before = -1;
      Lattice l;
      for (int k = 0; k < 5; ++k) {
        l = lattice(each, k % 2 == 0 ? 1.0 : 100.0);
        l.nz = l.nx;
        const int body = assembly.addSoft(l, falling(k == 0 ? 10 * scene.drag : 0.0));
        meet(body, l, -1, each, 0.0);
        for (int i = 0; before >= 0 && i < each; ++i) {
          // side faces: nodes, in turn
          const int y = i % l.ny, z = i / l.ny % l.nz;
          assembly.addContact(assembly.onNode(body, l.node(0, y, z)), assembly.onNode(before, l.node(l.nx - 1, y, z)),
                              Vec3::UnitX(), 0.0, scene.mu);
        }
        before = body;
      }
    }
    static Vec3 wall(double side) {
      const double slope = 10.0 * std::numbers::pi / 180.0;
      return {side * std::cos(slope), 0.0, std::sin(slope)};
    }
    void wedge() {
      Lattice l = lattice(scene.contacts / 2, 1.0);
      l.nx = 4;
      l.nz = l.ny;
      const int body = assembly.addSoft(l, {0.0, 0.1 * scene.drag, -5 * scene.press});
      for (int i = 0; i < scene.contacts; ++i) {
        const bool left = i % 2 == 0;
        const int y = i / 2 % l.ny, z = i / 2 / l.ny % l.nz;
        assembly.addContact(assembly.onNode(body, l.node(left ? 0 : l.nx - 1, y, z)), {}, wall(left ? 1.0 : -1.0), 0.0,
                            scene.mu);
      }
    }
    void rigidWedge() {
      const Vec3 size(0.05, 0.1, 0.1);
      const int body = assembly.addRigid(0.5, size, {0.0, 0.1 * scene.drag, -5 * scene.press});
      for (int i = 0; i < scene.contacts; ++i) {
        const double side = i % 2 == 0 ? 1.0 : -1.0;
        const Vec3 arm(-0.5 * side * size[0], size[1] * (uniform(random) - 0.5), size[2] * (uniform(random) - 0.5));
        assembly.addContact(assembly.onRigid(body, arm), {}, wall(side), 0.0, scene.mu);
      }
    }
  };
};

}  // namespace palpate::test
