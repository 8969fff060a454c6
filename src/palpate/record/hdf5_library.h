#pragma once

#include <cstddef>
#include <cstdint>

namespace palpate {

/// What is used of libhdf5, under its own names (H5Fcreate -> file_create). Loaded when it is first asked for, so that
/// the program does not need the library otherwise. Types are those of every release since 1.10.
struct Hdf5 {
  using Id = std::int64_t;
  using Size = unsigned long long;

  /// @throws InputError that says what to install, where there is none
  static const Hdf5& library();

  Id (*file_create)(const char* name, unsigned flags, Id create, Id access) = nullptr;
  int (*file_close)(Id file) = nullptr;
  Id (*property_create)(Id kind) = nullptr;
  int (*property_close)(Id list) = nullptr;
  int (*set_chunk)(Id list, int rank, const Size* size) = nullptr;
  int (*set_chunk_cache)(Id list, std::size_t slots, std::size_t bytes, double policy) = nullptr;
  int (*set_shuffle)(Id list) = nullptr;
  int (*set_deflate)(Id list, unsigned level) = nullptr;
  int (*track_times)(Id list, bool on) = nullptr;
  int (*filter_available)(int filter) = nullptr;
  Id (*space_create)(int rank, const Size* now, const Size* most) = nullptr;
  int (*space_close)(Id space) = nullptr;
  int (*select)(Id space, int how, const Size* start, const Size* stride, const Size* count,
                const Size* block) = nullptr;
  Id (*dataset_create)(Id file, const char* name, Id type, Id space, Id link, Id create, Id access) = nullptr;
  int (*set_extent)(Id dataset, const Size* size) = nullptr;
  Id (*dataset_space)(Id dataset) = nullptr;
  int (*dataset_write)(Id dataset, Id type, Id memory, Id file, Id transfer, const void* data) = nullptr;
  int (*dataset_close)(Id dataset) = nullptr;
  Id (*type_copy)(Id type) = nullptr;
  int (*type_set_size)(Id type, std::size_t size) = nullptr;
  int (*type_close)(Id type) = nullptr;

  Id double_type = -1, integer_type = -1, text_type = -1;  ///< little-endian in the file and here: 64 bits; C text
  Id dataset_properties = -1, dataset_access = -1;         ///< kinds, for property_create

 private:
  Hdf5();
};

}  // namespace palpate
