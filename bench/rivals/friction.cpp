// Frictional contact with the exact cone, from zero: ContactSolver and Siconos on the same problems. Writes a table.
#include <siconos/numerics/FrictionContactProblem.h>
#include <siconos/numerics/Friction_cst.h>
#include <siconos/numerics/NonSmoothDrivers.h>
#include <siconos/numerics/NumericsMatrix.h>
#include <siconos/numerics/NumericsVerbose.h>
#include <siconos/numerics/SolverOptions.h>

#include <cstdio>
#include <string>

#include "alternate.h"
#include "palpate/friction/contact_solver.h"
#include "shared/coupled_problems.h"

namespace palpate::rivals {
namespace {

using test::CoupledScene;
using test::Coupling;
using test::OwnedProblem;
using test::SoftBar;

constexpr double kTolerance = 1e-8;  // of our residual, relative to the largest velocity; of Siconos' own norm

double scale(const OwnedProblem& p) {
  return std::max(p.free.lpNorm<Eigen::Infinity>(), p.bias.lpNorm<Eigen::Infinity>());
}

struct Outcome {
  int iterations = 0;
  double residual = 0;  // relative to the largest velocity
};

/// A problem in Siconos, in the same units.
class Siconos {
 public:
  Siconos(const OwnedProblem& p, int solver, int limit)
      : problem_(p), matrix_(p.delassus), q_(p.free), mu_(p.friction) {
    for (Eigen::Index i = 0; i < p.bias.size(); ++i) q_[3 * i] -= p.bias[i];
    const int rows = static_cast<int>(q_.size());
    wrapped_ = NM_create_from_data(NM_DENSE, rows, rows, matrix_.data());
    siconos_.dimension = 3;
    siconos_.numberOfContacts = rows / 3;
    siconos_.M = wrapped_;
    siconos_.q = q_.data();
    siconos_.mu = mu_.data();
    options_ = solver_options_create(solver);
    options_->dparam[SICONOS_DPARAM_TOL] = kTolerance;
    options_->iparam[SICONOS_IPARAM_MAX_ITER] = limit;
  }
  ~Siconos() { solver_options_delete(options_); }
  Siconos(const Siconos&) = delete;
  Siconos& operator=(const Siconos&) = delete;

  void solve() {
    reaction_.setZero(q_.size());
    velocity_.setZero(q_.size());
    fc3d_driver(&siconos_, reaction_.data(), velocity_.data(), options_);
  }
  Outcome outcome() const {
    return {options_->iparam[SICONOS_IPARAM_ITER_DONE], contactResidual(problem_.view(), reaction_) / scale(problem_)};
  }

 private:
  const OwnedProblem& problem_;
  MatX matrix_;
  VecX q_, mu_, reaction_, velocity_;
  NumericsMatrix* wrapped_ = nullptr;
  FrictionContactProblem siconos_{};
  SolverOptions* options_ = nullptr;
};

std::string cell(double time, double base, const Outcome& o) {
  char residual[32];
  std::snprintf(residual, sizeof residual, "%.0e", o.residual);
  return (base > 0 ? against(time, base) : digits(1e3 * time)) + " | " + std::to_string(o.iterations) + " | " +
         residual;
}

void compare(const char* name, const OwnedProblem& p) {
  const int contacts = p.contacts();
  const bool many = contacts >= 500;
  Siconos sweeps(p, SICONOS_FRICTION_3D_NSGS, many ? 1000 : 5000);
  Siconos newton(p, SICONOS_FRICTION_3D_NSN_AC, many ? 30 : 200);
  Siconos proximal(p, SICONOS_FRICTION_3D_PROX, many ? 30 : 200);
  ContactSolver solver;
  ContactSolverSettings settings;
  settings.tolerance = kTolerance;
  VecX lambda;
  std::vector<ContactStatus> status;
  Outcome own;
  const auto solve = [&] {
    lambda.setZero(p.free.size());
    status.clear();
    own.iterations = solver.solve(p.view(), settings, lambda, status).iterations;
  };
  const std::vector<double> t = alternate(
      {{{}, solve}, {{}, [&] { sweeps.solve(); }}, {{}, [&] { newton.solve(); }}, {{}, [&] { proximal.solve(); }}},
      many ? 1 : 5);
  own.residual = contactResidual(p.view(), lambda) / scale(p);
  std::printf("| %s, %d | %s | %s | %s | %s |\n", name, contacts, cell(t[0], 0, own).c_str(),
              cell(t[1], t[0], sweeps.outcome()).c_str(), cell(t[2], t[0], newton.outcome()).c_str(),
              cell(t[3], t[0], proximal.outcome()).c_str());
  std::fflush(stdout);
}

/// A soft bar on the ground: a contact on each node, or as many points on a third of the nodes.
OwnedProblem bar(int contacts, bool separate) {
  SoftBar b;
  b.bumpiness = 1e-4;
  b.nz = 3;
  const int nodes = separate ? contacts : std::max(4, contacts / 3);
  b.nx = static_cast<int>(std::sqrt(nodes));
  while (nodes % b.nx != 0) --b.nx;
  b.ny = nodes / b.nx;
  if (!separate) b.nx = b.ny = std::max(2, static_cast<int>(std::sqrt(nodes)));
  return b.make(contacts, separate, 1, {true, 8});
}

OwnedProblem coupled(Coupling kind, int contacts) {
  CoupledScene scene;
  scene.kind = kind;
  scene.contacts = contacts;
  return scene.make({true, 8});
}

}  // namespace
}  // namespace palpate::rivals

int main(int argc, char** argv) {
  using namespace palpate;
  using namespace palpate::rivals;
  const int most = argc > 1 ? std::atoi(argv[1]) : 500;
  numerics_set_verbose(0);
  std::printf("Milliseconds (times ours), iterations, residual.\n\n");
  std::printf(
      "| Problem, contacts | ours | it. | res. | NSGS | it. | res. | Newton | it. | res. | "
      "proximal | it. | res. |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const int contacts : {10, 50, 100, 500}) {
    if (contacts > most) break;
    compare("separate", bar(contacts, true));
    compare("redundant", bar(contacts, false));
    if (contacts == 500) break;  // minutes
    compare("flat", coupled(Coupling::flat, contacts));
    compare("rigid stack", coupled(Coupling::rigid_stack, contacts));
  }
}
