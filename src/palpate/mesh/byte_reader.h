#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <string_view>

namespace palpate {

/// Numbers from a byte sequence; take() is false when too few bytes are left.
class ByteReader {
 public:
  ByteReader(std::string_view data, bool big_endian)
      : data_(data), swap_(big_endian == (std::endian::native == std::endian::little)) {}

  template <class T>
  bool take(T& value) {
    if (data_.size() < sizeof(T)) return false;
    char bytes[sizeof(T)];
    for (size_t i = 0; i < sizeof(T); ++i) bytes[i] = data_[swap_ ? sizeof(T) - 1 - i : i];
    std::memcpy(&value, bytes, sizeof(T));
    data_.remove_prefix(sizeof(T));
    return true;
  }
  bool skip(size_t bytes) {
    if (data_.size() < bytes) return false;
    data_.remove_prefix(bytes);
    return true;
  }
  size_t left() const { return data_.size(); }

 private:
  std::string_view data_;
  bool swap_;
};

}  // namespace palpate
