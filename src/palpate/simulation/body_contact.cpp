// What contact asks of a body: rows of the Delassus operator, impulses, the motion of points.
#include <cmath>
#include <numeric>

#include "palpate/common/parallel.h"
#include "palpate/contact/contact_rows.h"
#include "palpate/linear/triangular_solve.h"
#include "palpate/math/decompositions.h"
#include "palpate/math/rotation.h"
#include "palpate/simulation/body_system.h"

namespace palpate {

// Contact impulses on the free nodes, into prediction_, and on the handle; whether there are any.
bool BodySystem::addImpulses(const std::vector<Contact>& contacts, const ContactRows& own, int self,
                             const VecX& impulse, Vec6& on_handle) {
  prediction_.setZero(3 * model_->freeNodes(), 1);
  on_handle.setZero();
  if (!model_->fixedElements().empty()) on_fixed_.setZero(3 * model_->nodes());
  if (model_->glues()) on_glued_.setZero(3 * model_->nodes());
  for (const int i : own.contacts) {
    const Vec3 world = contacts[i].frame().transpose() * impulse.segment<3>(3 * i);
    if (model_->glues() && contacts[i].glued() && contacts[i].first.body == self) {
      on_glued_.segment<3>(3 * contacts[i].first.node[0]) += world;
    }
    forEachNode(contacts[i], self, [&](int node, double weight) {
      const Vec3 share = weight * world;
      if (row(node) >= 0) {
        prediction_.block<3, 1>(3 * row(node), 0) += share;
      } else if (model_->isFixed(node)) {
        on_fixed_.segment<3>(3 * node) += share;
      } else {
        on_handle += jacobian(node).transpose() * share;
      }
    });
  }
  return !own.contacts.empty();
}

void BodySystem::predict(const std::vector<Contact>& contacts, const ContactRows& own, int self, const VecX& impulse) {
  Vec6 on_handle;
  v_end_ = v_free_;
  u_end_ = u_free_;
  if (!addImpulses(contacts, own, self, impulse, on_handle)) return;
  if (!model_->free().empty()) solve(prediction_);
  v_end_ += prediction_.col(0);
  if (model_->framed()) {
    const Vec6 du = s_inverse_ * (on_handle - a_th_.transpose() * prediction_.col(0));
    u_end_ += du;
    v_end_ -= x_th_ * du;
  }
}

void BodySystem::solveFreeAgain() {
  const VecX v = v_end_;
  const Vec6 u = u_end_;
  solveFree();
  v_end_ = v;
  u_end_ = u;
}

// Appends J_t^T of a contact to columns_, and sets its columns of J_h^T and z.
void BodySystem::addColumns(const Contact& c, int self, Eigen::Index column, BodyContactRows& rows) {
  const Mat3 frame = c.frame().transpose();
  if (model_->framed()) {
    rows.handle.middleCols<3>(column).setZero();
    rows.z.middleCols<3>(column).setZero();
  }
  forEachNode(c, self, [&](int node, double weight) {
    const Mat3 block = weight * frame;
    if (row(node) >= 0) {
      columns_.add(row(node), turned_ ? Mat3(turn_.transpose() * block) : block);
      if (model_->framed()) rows.z.middleCols<3>(column) -= x_th_.middleRows<3>(3 * row(node)).transpose() * block;
    } else if (!model_->isFixed(node)) {
      rows.handle.middleCols<3>(column) += jacobian(node).transpose() * block;
    }
  });
  columns_.close();
  if (model_->framed()) rows.z.middleCols<3>(column) += rows.handle.middleCols<3>(column);
}

void BodySystem::contactRows(const std::vector<Contact>& contacts, int self, const std::vector<char>& changed,
                             BodyContactRows& rows) {
  const Eigen::Index count = rows.rows();
  changed_.clear();
  for (std::size_t k = 0; k < rows.contacts.size(); ++k) {
    if (k >= rows.known || changed[rows.contacts[k]]) changed_.push_back(static_cast<int>(k));
  }
  rows.known = rows.contacts.size();
  if (changed_.empty()) return;
  // a changed contact costs a solve with three columns; beyond some share of them all columns at once are cheaper
  constexpr std::size_t kFew = 4;
  const bool few = kFew * changed_.size() < rows.contacts.size();
  if (!few) {
    changed_.resize(rows.contacts.size());
    std::iota(changed_.begin(), changed_.end(), 0);
  }
  if (model_->framed()) {
    rows.handle.conservativeResize(6, count);
    rows.z.conservativeResize(6, count);
  }
  columns_.clear();
  for (const int k : changed_) addColumns(contacts[rows.contacts[k]], self, 3 * k, rows);
  if (few) {
    rows.delassus.conservativeResize(count, count);
    updateDelassus(contacts, self, rows);
  } else {
    formDelassus(rows);
  }
}

double BodySystem::contactOperations(const BodyContactRows& rows) const {
  return rowOperations(3.0 * static_cast<double>(changed_.size()), static_cast<double>(rows.rows()));
}

double BodySystem::rowOperations(double changed, double rows) const {
  const double last = 3.0 * static_cast<double>(order_.last_nodes.size());
  return kDense * changed * last * (last + rows);
}

// All of it, from columns_.
void BodySystem::formDelassus(BodyContactRows& rows) {
  const Eigen::Index count = rows.rows();
  if (model_->free().empty()) {
    rows.delassus.setZero(count, count);
  } else if (!nodes_last_) {
    factor_.gram(columns_, rows.delassus);
  } else {
    half_.setZero(static_cast<Eigen::Index>(3 * order_.last_nodes.size()), count);
    for (Eigen::Index c = 0; c < columns_.size(); ++c) {
      for (int k = columns_.begin[c]; k < columns_.begin[c + 1]; ++k) {
        half_.block<3, 3>(3 * trailing_[model_->free()[columns_.node[k]]], 3 * c) += columns_.block[k];
      }
    }
    rows.delassus.setZero(count, count);
    // Eigen divides by the number of rows to choose its blocks
    if (half_.rows() > 0) {
      solveLowerInPlace(factor_.trailing(), half_);
      rows.delassus.selfadjointView<Eigen::Lower>().rankUpdate(half_.transpose());
    }
  }
  if (model_->framed()) addHandleDelassus(rows);
}

// z^T S^-1 z: what the handle's motion adds; in tiles that stay in the cache.
void BodySystem::addHandleDelassus(BodyContactRows& rows) const {
  const Eigen::Index count = rows.rows();
  constexpr int kTile = 64;
  parallelFor(static_cast<int>((count + kTile - 1) / kTile), [&](int tile) {
    const Eigen::Index j = tile * kTile, width = std::min<Eigen::Index>(kTile, count - j), below = count - j - width;
    const Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, kTile> moved = s_inverse_ * rows.z.middleCols(j, width);
    rows.delassus.block(j, j, width, width).triangularView<Eigen::Lower>() +=
        rows.z.middleCols(j, width).transpose() * moved;
    rows.delassus.block(j + width, j, below, width).noalias() += rows.z.rightCols(below).transpose() * moved;
  });
}

// Rows and columns of the changed contacts, by a solve with their columns.
void BodySystem::updateDelassus(const std::vector<Contact>& contacts, int self, BodyContactRows& rows) {
  response_.setZero(3 * model_->freeNodes(), 3 * columns_.size());
  for (Eigen::Index c = 0; c < columns_.size(); ++c) {
    for (int k = columns_.begin[c]; k < columns_.begin[c + 1]; ++k) {
      response_.block<3, 3>(3 * columns_.node[k], 3 * c) += columns_.block[k];
    }
  }
  if (!model_->free().empty()) solveTurned(response_);
  image_ = rowVelocity(contacts, rows, self, response_);
  if (model_->framed()) {
    for (std::size_t c = 0; c < changed_.size(); ++c) {
      image_.middleCols<3>(static_cast<Eigen::Index>(3 * c)) +=
          rows.z.transpose() * (s_inverse_ * rows.z.middleCols<3>(3 * changed_[c]));
    }
  }
  for (std::size_t c = 0; c < changed_.size(); ++c) {
    const Eigen::Index own = 3 * changed_[c];
    const auto column = image_.middleCols<3>(static_cast<Eigen::Index>(3 * c));
    rows.delassus.block(own, own, rows.delassus.rows() - own, 3) = column.bottomRows(rows.delassus.rows() - own);
    rows.delassus.block(own, 0, 3, own) = column.topRows(own).transpose();
  }
}

MatX BodySystem::rowVelocity(const std::vector<Contact>& contacts, const ContactRows& own, int self,
                             const MatX& v) const {
  MatX out = MatX::Zero(own.rows(), v.cols());
  for (std::size_t i = 0; i < own.contacts.size(); ++i) {
    const Contact& c = contacts[own.contacts[i]];
    auto rows = out.middleRows<3>(static_cast<Eigen::Index>(3 * i));
    forEachNode(c, self, [&](int node, double weight) {
      if (row(node) >= 0) rows += weight * v.middleRows<3>(3 * row(node));
    });
    const Mat3 frame = c.frame();
    for (Eigen::Index k = 0; k < rows.cols(); ++k) rows.col(k) = (frame * rows.col(k)).eval();
  }
  return out;
}

void BodySystem::nodeVelocity(const ContactPoint& point, const VecX& v, const Vec6& u, Vec3& out) const {
  out.setZero();
  for (int k = 0; k < point.count; ++k) {
    const int node = point.node[k];
    if (row(node) >= 0) {
      out += point.weight[k] * v.segment<3>(3 * row(node));
    } else if (model_->isFixed(node)) {
      out += point.weight[k] * fixedVelocity(node);
    } else {
      out += point.weight[k] * (jacobian(node) * u);
    }
  }
}

void BodySystem::addFreeRowVelocity(const std::vector<Contact>& contacts, const ContactRows& own, int self,
                                    VecX& velocity) const {
  Vec3 v;
  for (const int i : own.contacts) {
    auto rows = velocity.segment<3>(3 * i);
    if (contacts[i].first.body == self) {
      nodeVelocity(contacts[i].first, v_free_, u_free_, v);
      rows += contacts[i].frame() * v;
    }
    if (contacts[i].second.body == self) {
      nodeVelocity(contacts[i].second, v_free_, u_free_, v);
      rows -= contacts[i].frame() * v;
    }
  }
}

void BodySystem::applyImpulse(const std::vector<Contact>& contacts, const BodyContactRows& rows, int self,
                              const VecX& lambda) {
  v_end_ = v_free_;
  u_end_ = u_free_;
  resisting_ = 0;
  if (!addImpulses(contacts, rows, self, lambda, on_handle_)) return;
  if (!model_->free().empty() && nodes_last_) {
    on_trailing_.resize(static_cast<Eigen::Index>(3 * order_.last_nodes.size()));
    for (std::size_t k = 0; k < order_.last_nodes.size(); ++k) {
      on_trailing_.segment<3>(static_cast<Eigen::Index>(3 * k)) =
          prediction_.block<3, 1>(3 * row(order_.last_nodes[k]), 0);
    }
    impulse_response_.resize(v_free_.size());
    if (turned_) turnVectors(turn_.transpose(), on_trailing_);
    factor_.solveFromTrailing(on_trailing_, impulse_response_);
    if (turned_) turnVectors(turn_, impulse_response_);
    v_end_ += impulse_response_;
  } else if (!model_->free().empty()) {
    solve(prediction_);
    v_end_ += prediction_.col(0);
  }
  if (model_->framed()) {
    const Vec6 impulse = rows.z * rows.gather(lambda);
    resisting_ = impulse.head<3>().norm() / input_.step;
    const Vec6 du = s_inverse_ * impulse;
    u_end_ += du;
    v_end_ -= x_th_ * du;
  }
}

double BodySystem::motion() const {
  double sum = model_->framed() ? u_end_.dot(mass0_ * u_end_) : 0.0;
  for (int r = 0; r < model_->freeNodes(); ++r) {
    sum += model_->elasticity().mass()[model_->free()[r]] * v_end_.segment<3>(3 * r).squaredNorm();
  }
  return std::sqrt(sum);
}

Vec3 BodySystem::pointVelocity(const ContactPoint& point) const {
  Vec3 v;
  nodeVelocity(point, v_end_, u_end_, v);
  return v;
}

bool BodySystem::canMove(const ContactPoint& point) const {
  constexpr double kLeast = 1e-6;  // of its weight: what moves it by less is rounding of where it is embedded
  double movable = 0;
  for (int k = 0; k < point.count; ++k) {
    if (!model_->isFixed(point.node[k])) movable += std::abs(point.weight[k]);
  }
  return movable > kLeast;
}

// G of a point on the handle: the weighted sum of its attached nodes'.
Eigen::Matrix<double, 3, 6> BodySystem::attachedJacobian(const ContactPoint& point) const {
  Eigen::Matrix<double, 3, 6> g = Eigen::Matrix<double, 3, 6>::Zero();
  for (int k = 0; k < point.count; ++k) {
    if (model_->attachedIndex()[point.node[k]] >= 0) g += point.weight[k] * jacobian(point.node[k]);
  }
  return g;
}

Mat3 BodySystem::pointInverseMass(const ContactPoint& point) const {
  Mat3 w = Mat3::Zero();
  for (int k = 0; k < point.count; ++k) {
    if (row(point.node[k]) < 0) continue;
    w.diagonal().array() += point.weight[k] * point.weight[k] / model_->elasticity().mass()[point.node[k]];
  }
  if (model_->framed()) {
    const Eigen::Matrix<double, 3, 6> g = attachedJacobian(point);
    if (!g.isZero(0.0)) w += g * inverse(mass0_) * g.transpose();
  }
  return w;
}

void BodySystem::pushPoint(const ContactPoint& point, const Vec3& impulse) {
  for (int k = 0; k < point.count; ++k) {
    const int r = row(point.node[k]);
    if (r < 0) continue;
    v_end_.segment<3>(3 * r) += point.weight[k] / model_->elasticity().mass()[point.node[k]] * impulse;
  }
  if (model_->framed()) {
    const Eigen::Matrix<double, 3, 6> g = attachedJacobian(point);
    if (!g.isZero(0.0)) u_end_ += solveSymmetric(mass0_, g.transpose() * impulse);
  }
}

void BodySystem::stop() {
  turns_ = false;
  v_end_.setZero();
  u_end_.setZero();
}

void BodySystem::endPositions(VecX& x) const {
  const double h = input_.step;
  x.resize(x0_.size());
  for (int r = 0; r < model_->freeNodes(); ++r) {
    x.segment<3>(3 * model_->free()[r]) = x0_.segment<3>(3 * model_->free()[r]) + h * v_end_.segment<3>(3 * r);
  }
  for (const Attachment& attachment : model_->attachments()) {
    if (!attachment.fixed()) continue;
    for (const int n : attachment.nodes) x.segment<3>(3 * n) = anchors_.segment<3>(3 * n);
  }
  if (model_->framed()) {
    const Pose end = palpate::advance(start_.pose, h * u_end_);
    for (std::size_t k = 0; k < handle().nodes.size(); ++k) {
      x.segment<3>(3 * handle().nodes[k]) = end.apply(handle().offsets[k]);
    }
  }
}

Vec3 BodySystem::arcOffset(const ContactPoint& point, const VecX& x_end) const {
  Vec3 offset = Vec3::Zero();
  for (int k = 0; k < point.count; ++k) {
    const int node = point.node[k];
    if (model_->attachedIndex()[node] < 0) continue;
    const Vec3 straight = input_.step * (jacobian(node) * u_end_);
    offset += point.weight[k] * (x_end.segment<3>(3 * node) - x0_.segment<3>(3 * node) - straight);
  }
  return offset;
}

}  // namespace palpate
