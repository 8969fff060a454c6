#include "palpate/record/hdf5_library.h"

#include <fmt/format.h>

#include "palpate/common/dynamic_library.h"
#include "palpate/common/error.h"

namespace palpate {
namespace {

DynamicLibrary load() {
  try {
    return DynamicLibrary({"libhdf5_serial.so.103", "libhdf5.so.103", "libhdf5_serial.so", "libhdf5.so"});
  } catch (const RunError& e) {
    throw InputError("hdf5", "",
                     fmt::format("the library libhdf5 is needed (apt-get install libhdf5-103-1): {}", e.what()));
  }
}

}  // namespace

Hdf5::Hdf5() {
  const DynamicLibrary from = load();
  int (*open)() = nullptr;
  int (*version)(unsigned*, unsigned*, unsigned*) = nullptr;
  int (*without_exit)() = nullptr;
  int (*set_errors)(Id stack, void* function, void* data) = nullptr;
  from.find(without_exit, "H5dont_atexit");
  from.find(open, "H5open");
  from.find(version, "H5get_libversion");
  from.find(set_errors, "H5Eset_auto2");
  unsigned major = 0, minor = 0, release = 0;
  without_exit();  // files that a failed job leaves open are no concern of the end of the program
  if (open() < 0 || version(&major, &minor, &release) < 0 || major != 1 || minor < 10) {
    throw InputError("hdf5", "",
                     fmt::format("{} is version {}.{}; 1.10 or newer is needed", from.name(), major, minor));
  }
  set_errors(0, nullptr, nullptr);  // they are exceptions here
  from.find(file_create, "H5Fcreate");
  from.find(file_close, "H5Fclose");
  from.find(property_create, "H5Pcreate");
  from.find(property_close, "H5Pclose");
  from.find(set_chunk, "H5Pset_chunk");
  from.find(set_chunk_cache, "H5Pset_chunk_cache");
  from.find(set_shuffle, "H5Pset_shuffle");
  from.find(set_deflate, "H5Pset_deflate");
  from.find(track_times, "H5Pset_obj_track_times");
  from.find(filter_available, "H5Zfilter_avail");
  from.find(space_create, "H5Screate_simple");
  from.find(space_close, "H5Sclose");
  from.find(select, "H5Sselect_hyperslab");
  from.find(dataset_create, "H5Dcreate2");
  from.find(set_extent, "H5Dset_extent");
  from.find(dataset_space, "H5Dget_space");
  from.find(dataset_write, "H5Dwrite");
  from.find(dataset_close, "H5Dclose");
  from.find(type_copy, "H5Tcopy");
  from.find(type_set_size, "H5Tset_size");
  from.find(type_close, "H5Tclose");
  const auto value = [&](const char* symbol) {
    const Id* found = nullptr;
    from.find(found, symbol);
    return *found;
  };
  double_type = value("H5T_IEEE_F64LE_g");
  integer_type = value("H5T_STD_I64LE_g");
  text_type = value("H5T_C_S1_g");
  dataset_properties = value("H5P_CLS_DATASET_CREATE_ID_g");
  dataset_access = value("H5P_CLS_DATASET_ACCESS_ID_g");
}

const Hdf5& Hdf5::library() {
  static const Hdf5 loaded;
  return loaded;
}

}  // namespace palpate
