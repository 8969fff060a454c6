#pragma once

#include <array>
#include <memory>
#include <vector>

/// Two moving triangle surfaces in FCL. A shared library of its own, with types of the standard library only: Debian's
/// FCL is compiled for any processor, so its Eigen types have another layout than Palpate's.
namespace palpate::rivals {

using Points = std::vector<std::array<double, 3>>;
using Triangles = std::vector<std::array<int, 3>>;

class __attribute__((visibility("default"))) FclPair {
 public:
  /// Vertices at rest.
  FclPair(const Points& left, const Points& right, const Triangles& triangles);
  ~FclPair();
  FclPair(const FclPair&) = delete;
  FclPair& operator=(const FclPair&) = delete;

  /// Moves the vertices on: where they were is the start of the step. Refits axis-aligned boxes around start and end.
  void moveTo(const Points& left, const Points& right);
  /// Places them for nearest() and firstTime(); refits oriented boxes and rounded rectangles.
  void place(const Points& left, const Points& right);

  /// fcl::distance: least distance of the placed surfaces [m].
  double nearest();
  /// fcl::continuousCollide by conservative advancement: time of the first contact if the right surface is moved, as a
  /// whole, by `motion`; 1 without one.
  double firstTime(const std::array<double, 3>& motion);

  struct Found {
    long pairs = 0;    ///< of triangles
    double first = 1;  ///< least time of contact; 1 without one
  };
  /// Own traversal of FCL's boxes with FCL's distance of triangles: all pairs of triangles that are below `reach` apart
  /// at the start or at the end.
  Found within(double reach);
  /// FCL's traversal for moving vertices: all pairs of triangles of which vertex and face or two edges meet.
  Found meeting();

 private:
  struct Models;
  std::unique_ptr<Models> models_;
};

}  // namespace palpate::rivals
