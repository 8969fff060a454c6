#include "palpate/study/stress.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <random>
#include <vector>

#include "palpate/contact/overlap.h"
#include "palpate/math/rotation.h"
#include "palpate/mesh/embedding_map.h"
#include "palpate/mesh/surface_measures.h"
#include "palpate/results/statistics.h"
#include "palpate/visual/visual_step.h"

namespace palpate {
namespace {

constexpr double kInside = 1e-4;  // of the tool's diagonal: a vertex less deep is on the surface, not on the wrong side

/// The random hand. Straight runs at up to full speed, turned round or broken off at random, never far from the start.
class WildHand {
 public:
  WildHand(const Pose& start, double reach, const StressSettings& settings)
      : start_(start), reach_(reach), settings_(settings), random_(settings.seed) {
    state_.pose = start;
  }

  DeviceTarget next(bool calm) {
    if (calm) {
      state_.twist.setZero();
      return state_;
    }
    const double event = uniform(0, 1);
    if (event < 0.04) {
      teleport();
    } else if (event < 0.16) {
      state_.twist = -state_.twist;
    } else if (event < 0.34) {
      state_.twist.head<3>() = uniform(0.2, 1) * settings_.speed * direction();
      state_.twist.tail<3>() = uniform(0, 1) * settings_.spin * direction();
    }
    state_.pose = advance(state_.pose, settings_.step * state_.twist);
    const Vec3 away = state_.pose.position - start_.position;
    if (away.norm() > reach_) {
      state_.pose.position = start_.position + reach_ * away.normalized();
      state_.twist.head<3>() = -state_.twist.head<3>();
    }
    return state_;
  }

 private:
  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  Vec3 direction() {
    Vec3 d;
    do {
      d = Vec3(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
    } while (d.norm() > 1 || d.norm() < 1e-3);
    return d.normalized();
  }
  void teleport() {
    state_.pose.position = start_.position + uniform(0, reach_) * direction();
    state_.pose.rotation = expRotation(uniform(0, 3) * direction()) * start_.rotation;
  }

  Pose start_;
  double reach_;
  StressSettings settings_;
  std::mt19937_64 random_;
  DeviceTarget state_;
};

/// Depth of the deepest surface point of any body in a plane or in another solid, and how many vertices are inside one.
struct Intrusion {
  double depth = 0;  // [m]
  int vertices = 0;
};

/// Examines a world's surfaces apart from the step's own contacts.
class Examiner {
 public:
  explicit Examiner(const World& world) {
    for (int i = 0; i < world.bodies(); ++i) {
      const SimulationMesh& mesh = world.body(i).model.mesh();
      surfaces_.emplace_back(mesh.surface);
      embeddings_.emplace_back(mesh.mesh, mesh.embedding);
    }
    for (const Obstacle& o : world.obstacles) {
      if (const std::optional<Surface> s = surfaceOf(o)) surfaces_.emplace_back(*s);
    }
  }

  Intrusion examine(const World& world, double inside) {
    Intrusion out;
    for (int i = 0; i < world.bodies(); ++i) {
      CollisionSurface& s = surfaces_[i];
      embeddings_[i].interpolate(world.body(i).state.positions.data(), s.start.data()->data());
      s.end = s.start;
      s.refit();
      for (const Obstacle& o : world.obstacles) {
        const auto* plane = std::get_if<PlaneShape>(&o.shape);
        if (plane == nullptr) continue;
        for (const Vec3& p : s.start) {
          const double depth = -gap(*plane, p);
          out.depth = std::max(out.depth, depth);
          if (depth > inside) ++out.vertices;
        }
      }
    }
    for (std::size_t b = 1; b < surfaces_.size(); ++b) {
      for (std::size_t a = 0; a < b; ++a) {
        if (a >= static_cast<std::size_t>(world.bodies())) continue;  // both fixed
        points_.clear();
        findOverlaps(surfaces_[a], surfaces_[b], points_);
        for (const OverlapPoint& p : points_) {
          out.depth = std::max(out.depth, p.depth);
          if (p.vertex[1] < 0 && p.depth > inside) ++out.vertices;
        }
      }
    }
    return out;
  }

 private:
  std::vector<CollisionSurface> surfaces_;
  std::vector<EmbeddingMap> embeddings_;  // of the bodies, which come first
  std::vector<OverlapPoint> points_;
};

bool finite(const World& world) {
  for (int i = 0; i < world.bodies(); ++i) {
    const Body b = world.body(i);
    if (!b.state.positions.allFinite() || !b.state.velocities.allFinite()) return false;
  }
  return true;
}

}  // namespace

StressOutcome runStress(BuiltScene& scene, const StressSettings& settings,
                        const std::function<void(double)>& progress) {
  World& world = scene.world;
  world.link_force_limit = settings.max_force;
  world.link_torque_limit = settings.max_torque;
  const double diagonal = boundsOf(world.tool().model.mesh().surface.vertices).diagonal();
  WildHand hand(scene.start, settings.reach * diagonal, settings);
  Examiner examiner(world);
  const int burst = std::max(1, static_cast<int>(std::ceil(settings.burst / settings.step)));
  const int calm = std::max(1, static_cast<int>(std::ceil(settings.calm / settings.step)));
  const VisualStepSettings visual{scene.linearization, settings.step};
  HandleModel model;
  StressOutcome out;
  std::vector<double> times;
  for (int n = 0; n < settings.steps; ++n) {
    const int phase = n % (burst + calm);
    const bool violent = phase < burst && n + calm < settings.steps;
    const DeviceTarget target = hand.next(!violent);
    const auto begin = std::chrono::steady_clock::now();
    const VisualRecord record = visualStep(world, target, visual, n * settings.step, model);
    times.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
    model = record.model;
    const StepReport& report = record.step;
    ++out.steps;
    if (!finite(world)) ++out.nan;
    out.restored += report.status == StepStatus::restored ? 1 : 0;
    out.not_converged += report.status == StepStatus::contact_not_converged ? 1 : 0;
    out.cut += report.motion_share < 1 ? 1 : 0;
    out.max_kinetic = std::max(out.max_kinetic, report.kinetic_energy);
    out.max_elastic = std::max(out.max_elastic, report.elastic_energy);
    out.max_energy = std::max(out.max_energy, report.kinetic_energy + report.elastic_energy);
    const Intrusion in = examiner.examine(world, kInside * diagonal);
    out.deepest_penetration_rel = std::max(out.deepest_penetration_rel, in.depth / diagonal);
    if (phase == burst + calm - 1 || n == settings.steps - 1) out.wrong_side += in.vertices;
    if (progress) progress(static_cast<double>(n + 1) / settings.steps);
  }
  out.median_ms = percentile(times, 0.5);
  out.p99_ms = percentile(times, 0.99);
  out.max_ms = percentile(times, 1.0);
  return out;
}

}  // namespace palpate
