#include "fcl_pair.h"

#include <fcl/narrowphase/continuous_collision.h>
#include <fcl/narrowphase/detail/traversal/collision/mesh_continuous_collision_traversal_node.h>
#include <fcl/narrowphase/detail/traversal/collision_node.h>
#include <fcl/narrowphase/detail/traversal/distance/mesh_distance_traversal_node.h>
#include <fcl/narrowphase/distance.h>

#include <limits>

namespace palpate::rivals {
namespace {

using Swept = fcl::AABB<double>;
using Placed = fcl::OBBRSS<double>;
using Vectors = std::vector<fcl::Vector3d>;

/// FCL's continuous tests take volumes below 1e-7 for nothing, whatever the unit: in meters they never find triangles
/// of a few millimeters. In millimeters they do.
constexpr double kUnit = 1e3;

void convert(const Points& points, Vectors& out) {
  out.resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    out[i] = {kUnit * points[i][0], kUnit * points[i][1], kUnit * points[i][2]};
}

template <class Box>
void build(fcl::BVHModel<Box>& model, const Vectors& points, const Triangles& triangles) {
  std::vector<fcl::Triangle> corners;
  for (const auto& t : triangles) corners.emplace_back(t[0], t[1], t[2]);
  model.beginModel();
  model.addSubModel(points, corners);
  model.endModel();
}

/// Visits the triangles whose swept boxes come within reach.
class WithinReach : public fcl::detail::MeshDistanceTraversalNode<Swept> {
 public:
  WithinReach(const fcl::BVHModel<Swept>& a, const fcl::BVHModel<Swept>& b, double reach) : reach_(reach) {
    model1 = &a;
    model2 = &b;
  }
  mutable std::vector<std::array<int, 2>> found;

  bool canStop(double clearance) const override { return clearance >= reach_; }
  void leafTesting(int node1, int node2) const override {
    const int i = model1->getBV(node1).primitiveId(), j = model2->getBV(node2).primitiveId();
    if (distance(model1->prev_vertices, i, model2->prev_vertices, j) < reach_ ||
        distance(model1->vertices, i, model2->vertices, j) < reach_)
      found.push_back({i, j});
  }

 private:
  double distance(const fcl::Vector3d* p, int i, const fcl::Vector3d* q, int j) const {
    const fcl::Triangle &s = model1->tri_indices[i], &t = model2->tri_indices[j];
    fcl::Vector3d nearest_p, nearest_q;
    return fcl::detail::TriangleDistance<double>::triDistance(p[s[0]], p[s[1]], p[s[2]], q[t[0]], q[t[1]], q[t[2]],
                                                              nearest_p, nearest_q);
  }
  double reach_;
};

}  // namespace

struct FclPair::Models {
  fcl::BVHModel<Swept> swept_left, swept_right;
  std::shared_ptr<fcl::BVHModel<Placed>> left = std::make_shared<fcl::BVHModel<Placed>>(),
                                         right = std::make_shared<fcl::BVHModel<Placed>>();
  Vectors points;
  std::vector<std::array<int, 2>> found;
};

FclPair::FclPair(const Points& left, const Points& right, const Triangles& triangles)
    : models_(std::make_unique<Models>()) {
  Models& m = *models_;
  convert(left, m.points);
  build(m.swept_left, m.points, triangles);
  build(*m.left, m.points, triangles);
  convert(right, m.points);
  build(m.swept_right, m.points, triangles);
  build(*m.right, m.points, triangles);
}

FclPair::~FclPair() = default;

void FclPair::moveTo(const Points& left, const Points& right) {
  Models& m = *models_;
  for (const auto& [model, points] : {std::pair(&m.swept_left, &left), std::pair(&m.swept_right, &right)}) {
    convert(*points, m.points);
    model->beginUpdateModel();
    model->updateSubModel(m.points);
    model->endUpdateModel(true, true);
  }
}

void FclPair::place(const Points& left, const Points& right) {
  Models& m = *models_;
  for (const auto& [model, points] : {std::pair(m.left, &left), std::pair(m.right, &right)}) {
    convert(*points, m.points);
    model->beginReplaceModel();
    model->replaceSubModel(m.points);
    model->endReplaceModel(true, true);
  }
}

double FclPair::nearest() {
  const auto here = fcl::Transform3d::Identity();
  fcl::DistanceResultd result;
  return fcl::distance(models_->left.get(), here, models_->right.get(), here, fcl::DistanceRequestd(true), result) /
         kUnit;
}

double FclPair::firstTime(const std::array<double, 3>& motion) {
  const fcl::Transform3d here = fcl::Transform3d::Identity();
  fcl::Transform3d there = here;
  there.translation() = kUnit * fcl::Vector3d(motion[0], motion[1], motion[2]);
  fcl::ContinuousCollisionRequestd request(1000, 1e-6, fcl::CCDM_LINEAR, fcl::GST_LIBCCD,
                                           fcl::CCDC_CONSERVATIVE_ADVANCEMENT);
  fcl::ContinuousCollisionResultd result;
  fcl::continuousCollide(models_->left.get(), here, here, models_->right.get(), here, there, request, result);
  return result.is_collide ? result.time_of_contact : 1.0;
}

FclPair::Found FclPair::within(double reach) {
  WithinReach node(models_->swept_left, models_->swept_right, kUnit * reach);
  node.found.swap(models_->found);  // keeps its room
  node.found.clear();
  fcl::detail::distanceRecurse(&node, 0, 0, nullptr);
  const Found out{static_cast<long>(node.found.size()), 1.0};
  node.found.swap(models_->found);
  return out;
}

FclPair::Found FclPair::meeting() {
  fcl::detail::MeshContinuousCollisionTraversalNode<Swept> node;
  const auto here = fcl::Transform3d::Identity();
  fcl::CollisionRequestd request;
  request.num_max_contacts = std::numeric_limits<std::size_t>::max();
  fcl::detail::initialize(node, models_->swept_left, here, models_->swept_right, here, request);
  fcl::detail::collisionRecurse(&node, 0, 0, nullptr);
  return {static_cast<long>(node.pairs.size()), node.time_of_contact};
}

}  // namespace palpate::rivals
