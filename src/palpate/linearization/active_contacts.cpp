#include "palpate/linearization/active_contacts.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "palpate/linear/dense_lu.h"

namespace palpate {
namespace {

// Active contacts whose normal rows are independent: pivoted Cholesky of W_nn, dropping what others determine to a
// tenth. Of W the lower triangle is read.
std::vector<char> wellConditioned(const std::vector<ContactStatus>& status, const MatX& delassus) {
  constexpr double kIndependent = 0.1;  // of the contact's own compliance, once those chosen before it are held
  std::vector<int> active;
  for (std::size_t i = 0; i < status.size(); ++i) {
    if (status[i].state != ContactState::open) active.push_back(static_cast<int>(i));
  }
  const auto n = static_cast<Eigen::Index>(active.size());
  std::vector<char> chosen(status.size(), 0);
  if (n == 0) return chosen;
  VecX rest(n);
  for (Eigen::Index i = 0; i < n; ++i) rest[i] = delassus(3 * active[i], 3 * active[i]);
  const VecX full = rest;
  MatX factor(n, n);
  for (Eigen::Index k = 0; k < n; ++k) {
    Eigen::Index pivot = 0;
    const double share = rest.cwiseQuotient(full.cwiseMax(1e-300)).maxCoeff(&pivot);
    if (!(share > kIndependent)) break;
    chosen[active[pivot]] = 1;
    for (Eigen::Index i = 0; i < n; ++i) {
      factor(i, k) = delassus(3 * std::max(active[i], active[pivot]), 3 * std::min(active[i], active[pivot]));
    }
    if (k > 0) factor.col(k) -= factor.leftCols(k) * factor.row(pivot).head(k).transpose();
    factor.col(k) /= std::sqrt(rest[pivot]);
    rest -= factor.col(k).cwiseAbs2();
    rest[pivot] = 0;
  }
  return chosen;
}

// Active contacts of the island that the tool's motion reaches: its own, those of the bodies that it touches, and so
// on. Contacts that are open connect nothing here.
std::vector<char> reached(const ContactSet& set, const std::vector<int>& island, int tool) {
  std::vector<int> bodies{tool};
  std::vector<char> out(island.size(), 0);
  const auto known = [&](const ContactPoint& point) {
    return point.body >= 0 && std::find(bodies.begin(), bodies.end(), point.body) != bodies.end();
  };
  for (std::size_t before = 0; before < bodies.size();) {
    before = bodies.size();
    for (std::size_t i = 0; i < out.size(); ++i) {
      const Contact& c = set.contacts[island[i]];
      if (out[i] || set.status[island[i]].state == ContactState::open || !(known(c.first) || known(c.second))) continue;
      out[i] = 1;
      for (const ContactPoint* point : {&c.first, &c.second}) {
        if (point->body >= 0 && !known(*point)) bodies.push_back(point->body);
      }
    }
  }
  return out;
}

}  // namespace

// `hsl`: of the tool's contacts and its own part of W. With contacts decoupled from each other, other bodies drop out
// of the model (paper, section 3.5): they are taken to go their way whatever the tool does. Their compliance alone,
// without what holds them, would let a body that stands on the ground float away under the tool.
// `hsl-exact`: of the tool's island, as through W a contact of the tool answers for those of the bodies that it pushes.
// What other islands do does not depend on the handle. A rigid tool has nothing of its own that yields, and of one that
// is glued the rows act together, so `hsl` is `hsl-exact` for them.
ActiveContacts activeContacts(const World& world, const LinearizationSettings& settings) {
  ActiveContacts out;
  const ContactSet& set = world.contacts();
  const BodyContactRows* own = world.bodyRows(world.toolIndex());
  if (own == nullptr || own->contacts.empty()) return out;
  const bool glued = set.contacts[own->contacts.front()].glued();  // those come first
  if (set.active() == 0 && !glued) return out;
  const ContactIsland& island = set.islands[set.island[own->contacts.front()]];
  const bool diagonal = settings.delassus == DelassusModel::diagonal && !world.tool().model.isRigid() && !glued;
  out.own = own;
  out.model = diagonal ? DelassusModel::diagonal : DelassusModel::exact;
  out.list.contacts = diagonal ? own->contacts : island.contacts;
  out.delassus = diagonal ? &own->delassus : &island.delassus;
  out.handle = out.list.spread(*own, own->handle.transpose()).transpose();
  out.z = out.list.spread(*own, own->z.transpose()).transpose();
  const VecX island_velocity = set.rowVelocity(island);
  VecX row_velocity(out.list.rows());
  std::vector<ContactStatus> status;
  for (std::size_t k = 0; k < out.list.contacts.size(); ++k) {
    const int i = out.list.contacts[k];
    row_velocity.segment<3>(static_cast<Eigen::Index>(3 * k)) = island_velocity.segment<3>(3 * set.place[i]);
    status.push_back(set.status[i]);
  }
  const std::vector<char> used =
      diagonal ? wellConditioned(status, *out.delassus) : reached(set, out.list.contacts, world.toolIndex());
  out.law = contactResponse(set, out.list.contacts, used, world.contact.cone, row_velocity);
  return out;
}

MatX ActiveContacts::impulseResponse(const MatX& free_change, const MatX& given) const {
  const Eigen::Index n = law.d.size();
  const auto row = [&](Eigen::Index k) { return static_cast<Eigen::Index>(3 * law.contact[k]); };
  const auto compliance = [&](Eigen::Index k) -> Mat3 {
    return delassus->block<3, 3>(row(k), row(k)).selfadjointView<Eigen::Lower>();
  };
  MatX right(n, 12);
  for (Eigen::Index k = 0; k < n; ++k) {
    right.row(k) = law.c.col(k).transpose() * (given.middleRows<3>(row(k)) - free_change.middleRows<3>(row(k)));
  }
  MatX y(n, 12);
  if (model == DelassusModel::diagonal) {
    for (Eigen::Index k = 0; k < n; ++k) {
      y.row(k) = right.row(k) / (law.c.col(k).dot(compliance(k) * law.b.col(k)) + law.d[k]);
    }
  } else {
    MatX q(n, n);
    VecX column(delassus->rows());
    for (Eigen::Index l = 0; l < n; ++l) {
      column.noalias() = delassus->middleCols<3>(row(l)) * law.b.col(l);
      for (Eigen::Index k = 0; k < n; ++k) q(k, l) = law.c.col(k).dot(column.segment<3>(row(k)));
    }
    // Redundant contacts leave q singular but consistent: a shift far below the contact's own compliance changes no
    // force. Not relative to D, which is huge where a contact slides fast under next to no force. What is almost
    // redundant, such as contacts that nearly coincide, the shift alone would get wrong by up to a percent: so the
    // solution is refined.
    constexpr double kShift = 1e-11;
    q.diagonal() += law.d;
    MatX shifted = q;
    for (Eigen::Index k = 0; k < n; ++k) shifted(k, k) += kShift * law.c.col(k).dot(compliance(k) * law.c.col(k));
    std::vector<int> pivots;
    luInPlace(shifted, pivots);
    y = right;
    luSolveColumns(shifted, pivots, y);
    for (int round = 0; round < 2; ++round) {
      MatX more = right - q * y;
      luSolveColumns(shifted, pivots, more);
      y += more;
    }
  }
  MatX dlambda = MatX::Zero(free_change.rows(), 12);
  for (Eigen::Index k = 0; k < n; ++k) dlambda.middleRows<3>(row(k)) += law.b.col(k) * y.row(k);
  return dlambda;
}

}  // namespace palpate
