#pragma once

#include <cstdint>
#include <filesystem>

namespace palpate {

/// Room on a disk that is set aside while a job records, and given back when the disk is full, so that what then has to
/// be written still fits.
class SpaceReserve {
 public:
  /// @param file   that takes up the room; removed by release(), or by a signal that ends the program
  /// @param bytes  wanted; never more than a quarter of what is free. Where nothing can be set aside, nothing is.
  SpaceReserve(std::filesystem::path file, std::uintmax_t bytes);
  ~SpaceReserve() { release(); }
  SpaceReserve(const SpaceReserve&) = delete;
  SpaceReserve& operator=(const SpaceReserve&) = delete;

  void release() noexcept;
  std::uintmax_t bytes() const noexcept { return bytes_; }

 private:
  std::filesystem::path file_;
  std::uintmax_t bytes_ = 0;
};

}  // namespace palpate
