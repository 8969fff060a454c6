#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// Little-endian bytes of a message (docs/viewer.md). The machines that Palpate runs on are little-endian.
class ByteWriter {
 public:
  explicit ByteWriter(std::size_t reserve = 0) { bytes_.reserve(reserve); }

  void u32(std::uint64_t value) { put(static_cast<std::uint32_t>(value)); }
  void f32(double value) { put(static_cast<float>(value)); }
  void f64(double value) { put(value); }
  void vec(const Vec3& v) {
    for (int k = 0; k < 3; ++k) f32(v[k]);
  }
  void vec(const Vec6& v) {
    for (int k = 0; k < 6; ++k) f32(v[k]);
  }
  void pose(const Pose& p) {
    vec(p.position);
    f32(p.rotation.w());
    f32(p.rotation.x());
    f32(p.rotation.y());
    f32(p.rotation.z());
  }
  void f32s(const std::vector<float>& values) {
    bytes_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
  }
  /// Overwrites four bytes that were written before.
  void patch(std::size_t at, std::uint32_t value) { std::memcpy(bytes_.data() + at, &value, sizeof value); }
  std::size_t size() const { return bytes_.size(); }
  std::string take() { return std::move(bytes_); }

 private:
  template <typename T>
  void put(T value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  std::string bytes_;
};

}  // namespace palpate
