#include "arrays.h"

#include <cmath>

namespace palpate::python {

DoubleArray doubles(py::handle source, const std::string& what) {
  DoubleArray array = DoubleArray::ensure(source);
  if (!array) {
    PyErr_Clear();
    throw py::value_error(what + ": is no array of numbers");
  }
  return array;
}

namespace {

template <class Matrix>
Matrix matrixFrom(py::handle source, const std::string& what, py::ssize_t size) {
  const DoubleArray array = doubles(source, what);
  if (array.ndim() != 2 || array.shape(0) != size || array.shape(1) != size) {
    throw py::value_error(what + ": must be " + std::to_string(size) + " x " + std::to_string(size));
  }
  return Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(array.data(), size,
                                                                                                  size);
}

}  // namespace

VecX rowsOfThreeFrom(py::handle source, const std::string& what, py::ssize_t rows) {
  const DoubleArray array = doubles(source, what);
  // by the shape, not the size: transposed, each node would get numbers of others
  if (array.ndim() != 2 || array.shape(0) != rows || array.shape(1) != 3) {
    throw py::value_error(what + ": must be " + std::to_string(rows) + " x 3");
  }
  return Eigen::Map<const VecX>(array.data(), array.size());
}

Mat3 mat3From(py::handle source, const std::string& what) { return matrixFrom<Mat3>(source, what, 3); }
Mat6 mat6From(py::handle source, const std::string& what) { return matrixFrom<Mat6>(source, what, 6); }

Quat rotationFrom(py::handle source, const std::string& what) {
  const DoubleArray array = doubles(source, what);
  if (array.ndim() == 2) {
    const Mat3 m = mat3From(array, what);
    if (!((m * m.transpose() - Mat3::Identity()).norm() < 1e-6) || m.determinant() < 0) {
      throw py::value_error(what + ": is no rotation matrix");
    }
    return Quat(m).normalized();
  }
  const Vec4 q = vectorFrom<Vec4>(array, what, 4);
  if (!(q.norm() > 1e-6) || !q.allFinite()) throw py::value_error(what + ": is no quaternion w, x, y, z");
  const Quat rotation(q[0], q[1], q[2], q[3]);
  // one that is a unit quaternion already keeps its bits, so that a replay is exact
  return std::abs(rotation.squaredNorm() - 1.0) > 1e-12 ? rotation.normalized() : rotation;
}

DeviceState stateFrom(py::handle source, const char* what) {
  if (py::isinstance<DeviceState>(source)) return source.cast<DeviceState>();
  if (py::isinstance<Pose>(source)) {
    DeviceState state;
    state.pose = source.cast<Pose>();
    return state;
  }
  throw py::type_error(std::string(what) + ": must be a Pose or a DeviceState");
}

}  // namespace palpate::python
