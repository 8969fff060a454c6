#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <string>
#include <vector>

#include "palpate/haptics/device_state.h"
#include "palpate/math/types.h"

namespace palpate::python {

namespace py = pybind11;

/// What a NumPy view allows.
enum class Access { read, write };

/// A view on memory that `owner` keeps, without a copy; it keeps the owner alive.
template <class T>
py::array view(const T* data, std::vector<py::ssize_t> shape, std::vector<py::ssize_t> strides, py::handle owner,
               Access access) {
  py::array_t<T> array(std::move(shape), std::move(strides), data, owner);
  if (access == Access::read) {
    py::detail::array_proxy(array.ptr())->flags &= ~py::detail::npy_api::NPY_ARRAY_WRITEABLE_;
  }
  return array;
}

/// Rows of three, one after the other: (n, 3).
inline py::array rowsOfThree(const VecX& flat, py::handle owner, Access access = Access::read) {
  constexpr py::ssize_t kSize = sizeof(double);
  return view(flat.data(), {flat.size() / 3, 3}, {3 * kSize, kSize}, owner, access);
}
/// Any number of equal rows, C order.
template <class T>
py::array matrixView(const std::vector<T>& flat, py::ssize_t columns, py::handle owner) {
  constexpr py::ssize_t kSize = sizeof(T);
  return view(flat.data(), {static_cast<py::ssize_t>(flat.size()) / columns, columns}, {columns * kSize, kSize}, owner,
              Access::read);
}
template <class T>
py::array vectorView(const std::vector<T>& flat, py::handle owner) {
  return view(flat.data(), {static_cast<py::ssize_t>(flat.size())}, {sizeof(T)}, owner, Access::read);
}
/// A vector or matrix of Eigen as it lies in memory: matrices are in Fortran order.
template <class Derived>
py::array eigenView(const Eigen::PlainObjectBase<Derived>& m, py::handle owner, Access access) {
  constexpr py::ssize_t kSize = sizeof(double);
  if constexpr (Derived::ColsAtCompileTime == 1) {
    return view(m.data(), {m.size()}, {kSize}, owner, access);
  } else {
    return view(m.data(), {m.rows(), m.cols()}, {kSize, m.rows() * kSize}, owner, access);
  }
}

using DoubleArray = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// An array of float64 in C order, copied only if it is something else. @throws ValueError
DoubleArray doubles(py::handle source, const std::string& what);

/// The numbers of an array of one dimension and the given size. @throws ValueError
template <class Vector>
Vector vectorFrom(py::handle source, const std::string& what, py::ssize_t size) {
  const DoubleArray array = doubles(source, what);
  if (array.size() != size) {
    throw py::value_error(what + ": must be " + std::to_string(size) + " numbers, not " + std::to_string(array.size()));
  }
  if (array.ndim() != 1) {
    throw py::value_error(what + ": must have one dimension, not " + std::to_string(array.ndim()));
  }
  return Eigen::Map<const VecX>(array.data(), array.size());
}
inline Vec3 vec3From(py::handle source, const std::string& what) { return vectorFrom<Vec3>(source, what, 3); }
inline Vec6 vec6From(py::handle source, const std::string& what) { return vectorFrom<Vec6>(source, what, 6); }
/// The numbers of an array (rows, 3), one row after the other. @throws ValueError
VecX rowsOfThreeFrom(py::handle source, const std::string& what, py::ssize_t rows);
/// A 3x3 or 6x6 matrix. @throws ValueError
Mat3 mat3From(py::handle source, const std::string& what);
Mat6 mat6From(py::handle source, const std::string& what);
/// Unit quaternion from w, x, y, z, or from a rotation matrix. @throws ValueError
Quat rotationFrom(py::handle source, const std::string& what);
/// A pose at rest, or a state. @throws TypeError
DeviceState stateFrom(py::handle source, const char* what);

/// An array that owns a copy.
template <class Derived>
py::array copied(const Eigen::MatrixBase<Derived>& m) {
  if constexpr (Derived::ColsAtCompileTime == 1) {
    py::array_t<double> out(m.size());
    Eigen::Map<VecX>(out.mutable_data(), m.size()) = m;
    return out;
  } else {
    py::array_t<double> out({m.rows(), m.cols()});
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(out.mutable_data(), m.rows(),
                                                                                       m.cols()) = m;
    return out;
  }
}
inline py::array copied(const Quat& q) { return copied(Vec4(q.w(), q.x(), q.y(), q.z())); }

}  // namespace palpate::python
