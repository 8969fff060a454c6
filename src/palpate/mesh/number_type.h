#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "palpate/mesh/byte_reader.h"

namespace palpate {

/// Kinds of numbers in binary mesh files.
enum class NumberType { i8, u8, i16, u16, i32, u32, i64, u64, f32, f64 };

/// use(0) with a zero of that type.
template <class Use>
auto withNumber(NumberType type, Use&& use) {
  switch (type) {
    case NumberType::i8:
      return use(std::int8_t{});
    case NumberType::u8:
      return use(std::uint8_t{});
    case NumberType::i16:
      return use(std::int16_t{});
    case NumberType::u16:
      return use(std::uint16_t{});
    case NumberType::i32:
      return use(std::int32_t{});
    case NumberType::u32:
      return use(std::uint32_t{});
    case NumberType::i64:
      return use(std::int64_t{});
    case NumberType::u64:
      return use(std::uint64_t{});
    case NumberType::f32:
      return use(float{});
    case NumberType::f64:
      break;
  }
  return use(double{});
}

inline std::size_t bytesOf(NumberType type) {
  return withNumber(type, [](auto zero) { return sizeof zero; });
}
inline bool isWhole(NumberType type) { return type != NumberType::f32 && type != NumberType::f64; }

/// The next number; false when too few bytes are left.
inline bool takeNumber(ByteReader& bytes, NumberType type, double& value) {
  return withNumber(type, [&](auto raw) {
    if (!bytes.take(raw)) return false;
    value = static_cast<double>(raw);
    return true;
  });
}
/// The next number of a type that isWhole; false when too few bytes are left. What is too large becomes negative.
inline bool takeNumber(ByteReader& bytes, NumberType type, long long& value) {
  return withNumber(type, [&](auto raw) {
    if (!bytes.take(raw)) return false;
    if constexpr (std::is_integral_v<decltype(raw)>) value = static_cast<long long>(raw);
    return true;
  });
}

}  // namespace palpate
