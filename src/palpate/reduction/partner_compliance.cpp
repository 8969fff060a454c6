#include "palpate/reduction/partner_compliance.h"

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

}  // namespace

void addPartnerCompliance(World& world, int body, const std::vector<NodeSum>& sums, MatX& out) {
  BodySystem& system = world.body(body).system;
  const int tool = world.toolIndex();
  std::vector<NodeSum> all = sums;
  for (const Contact& c : world.state().contacts.loaded) {
    const ContactPoint* own = c.first.body == body ? &c.first : c.second.body == body ? &c.second : nullptr;
    if (own == nullptr || c.first.body == tool || c.second.body == tool) continue;
    NodeSum tie;
    for (int k = 0; k < own->count; ++k) tie.nodes.emplace_back(own->node[k], own->weight[k]);
    all.push_back(std::move(tie));
  }
  MatX w = gramOf(system, all);
  const auto m = static_cast<Eigen::Index>(3 * sums.size()), ties = w.rows() - m;
  MatX own = w.topLeftCorner(m, m);
  if (ties > 0) {
    MatX tied = w.bottomRightCorner(ties, ties);
    tied.diagonal().array() += 1e-6 * tied.diagonal().mean();
    own -= w.topRightCorner(m, ties) * solveSymmetric(tied, w.bottomLeftCorner(ties, m));
  }
  // impulse to velocity becomes force to displacement: in a step dx = h dv, dlambda = h df, and c = h (h + beta)
  own *= system.stiffnessScale();
  for (std::size_t i = 0; i < sums.size(); ++i) {
    for (std::size_t j = 0; j < sums.size(); ++j) {
      out.block<3, 3>(sums[i].row, sums[j].row) +=
          own.block<3, 3>(static_cast<Eigen::Index>(3 * i), static_cast<Eigen::Index>(3 * j));
    }
  }
}

}  // namespace palpate
