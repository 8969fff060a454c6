#include "palpate/reduction/partner_compliance.h"

#include <algorithm>

#include "palpate/linear/dense_cholesky.h"
#include "palpate/math/decompositions.h"

namespace palpate {
namespace {

// J A^-1 J^T over sums of nodes; A and J of the step's system.
MatX gramOf(BodySystem& system, const std::vector<NodeSum>& sums) {
  const BodyModel& model = system.model();
  const auto count = static_cast<Eigen::Index>(3 * sums.size());
  MatX out = MatX::Zero(count, count);
  MatX columns = MatX::Zero(3 * model.freeNodes(), count);
  Eigen::Matrix<double, 6, Eigen::Dynamic> handle = Eigen::Matrix<double, 6, Eigen::Dynamic>::Zero(6, count);
  for (std::size_t k = 0; k < sums.size(); ++k) {
    const auto at = static_cast<Eigen::Index>(3 * k);
    for (const auto& [node, weight] : sums[k].nodes) {
      const int row = model.row()[node];
      if (row >= 0) {
        columns.block<3, 3>(3 * row, at).diagonal().array() += weight;
      } else if (!model.isFixed(node)) {
        handle.middleCols<3>(at) +=
            weight * model.handle().jacobian(model.attachedIndex()[node], system.startPose()).transpose();
      }
    }
  }
  if (model.freeNodes() > 0) {
    MatX half = columns;
    system.factor().solve(half);
    out = columns.transpose() * half;
    if (model.framed()) handle -= system.response().transpose() * columns;
  }
  if (model.framed()) out += handle.transpose() * system.handleSchurInverse() * handle;
  return 0.5 * (out + out.transpose());
}

// The same of many sums: by half of the solve, and of columns with little in them. Adds the lower triangle.
void addGram(BodySystem& system, const std::vector<NodeSum>& sums, double scale, MatX& out) {
  if (system.model().framed()) {
    out += scale * gramOf(system, sums);
    return;
  }
  BlockColumns columns;
  for (const NodeSum& sum : sums) {
    for (const auto& [node, weight] : sum.nodes) {
      const int row = system.model().row()[node];
      if (row >= 0) columns.add(row, weight * Mat3::Identity());
    }
    columns.close();
  }
  MatX own;
  system.factor().gram(columns, own);
  out.triangularView<Eigen::Lower>() += scale * own;
}

// Of the last rows' diagonal: what says the same twice does no harm.
template <class Block>
void shiftDiagonal(Block&& held) {
  held.diagonal().array() += 1e-6 * held.diagonal().mean();
}

// Leaves of W the rows of the first sums, with all others held.
MatX tied(const MatX& w, Eigen::Index m) {
  const Eigen::Index ties = w.rows() - m;
  MatX own = w.topLeftCorner(m, m);
  if (ties == 0) return own;
  MatX held = w.bottomRightCorner(ties, ties);
  shiftDiagonal(held);
  own -= w.topRightCorner(m, ties) * solveSymmetric(held, w.bottomLeftCorner(ties, m));
  return own;
}

// The same of W's lower triangle, where there are many rows.
MatX tiedMany(const MatX& w, Eigen::Index m) {
  const Eigen::Index ties = w.rows() - m;
  MatX held = w.bottomRightCorner(ties, ties), half = w.bottomLeftCorner(ties, m);
  shiftDiagonal(held);
  MatX own = w.topLeftCorner(m, m).selfadjointView<Eigen::Lower>();
  if (!choleskyInPlace(held)) return own;
  held.triangularView<Eigen::Lower>().solveInPlace(half);
  own -= half.transpose() * half;
  return own;
}

NodeSum nodesOf(const ContactPoint& point, double sign) {
  NodeSum out;
  for (int k = 0; k < point.count; ++k) out.nodes.emplace_back(point.node[k], sign * point.weight[k]);
  return out;
}

bool involves(const Contact& c, int body) { return c.first.body == body || c.second.body == body; }

// Bodies that loaded glue joins to this one, itself first, without the tool.
std::vector<int> gluedTo(const std::vector<Contact>& loaded, int body, int tool) {
  std::vector<int> out{body};
  for (std::size_t k = 0; k < out.size(); ++k) {
    for (const Contact& c : loaded) {
      if (!c.glued() || !involves(c, out[k]) || involves(c, tool)) continue;
      const int other = c.first.body == out[k] ? c.second.body : c.first.body;
      if (std::find(out.begin(), out.end(), other) == out.end()) out.push_back(other);
    }
  }
  return out;
}

// Of several bodies that are glued: their own, the joints' rows and those of what else they touch held at zero [m/N].
MatX gluedCompliance(World& world, const std::vector<int>& bodies, const std::vector<NodeSum>& sums) {
  std::vector<const Contact*> ties;
  for (const Contact& c : world.state().contacts.loaded) {
    if (involves(c, world.toolIndex())) continue;
    if (std::any_of(bodies.begin(), bodies.end(), [&](int b) { return involves(c, b); })) ties.push_back(&c);
  }
  const auto rows = static_cast<Eigen::Index>(3 * (sums.size() + ties.size()));
  MatX w = MatX::Zero(rows, rows);
  for (const int b : bodies) {
    std::vector<NodeSum> own(sums.size());
    if (b == bodies.front()) own = sums;
    for (const Contact* c : ties) {
      own.push_back(c->first.body == b ? nodesOf(c->first, 1.0) : NodeSum{});
      if (c->second.body != b) continue;
      const NodeSum second = nodesOf(c->second, -1.0);
      own.back().nodes.insert(own.back().nodes.end(), second.nodes.begin(), second.nodes.end());
    }
    BodySystem& system = world.body(b).system;
    addGram(system, own, system.stiffnessScale(), w);
  }
  return tiedMany(w, static_cast<Eigen::Index>(3 * sums.size()));
}

// Of one body [m/N].
MatX ownCompliance(World& world, int body, const std::vector<NodeSum>& sums) {
  const int tool = world.toolIndex();
  std::vector<NodeSum> all = sums;
  for (const Contact& c : world.state().contacts.loaded) {
    if (!involves(c, body) || involves(c, tool)) continue;
    all.push_back(nodesOf(c.first.body == body ? c.first : c.second, 1.0));
  }
  BodySystem& system = world.body(body).system;
  return tied(gramOf(system, all), static_cast<Eigen::Index>(3 * sums.size())) * system.stiffnessScale();
}

}  // namespace

void addPartnerCompliance(World& world, int body, const std::vector<NodeSum>& sums, MatX& out) {
  // impulse to velocity becomes force to displacement: in a step dx = h dv, dlambda = h df, and c = h (h + beta)
  const std::vector<int> together = gluedTo(world.state().contacts.loaded, body, world.toolIndex());
  const MatX own = together.size() > 1 ? gluedCompliance(world, together, sums) : ownCompliance(world, body, sums);
  for (std::size_t i = 0; i < sums.size(); ++i) {
    for (std::size_t j = 0; j < sums.size(); ++j) {
      out.block<3, 3>(sums[i].row, sums[j].row) +=
          own.block<3, 3>(static_cast<Eigen::Index>(3 * i), static_cast<Eigen::Index>(3 * j));
    }
  }
}

}  // namespace palpate
