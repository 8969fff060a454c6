#pragma once

#include <string>
#include <vector>

namespace palpate {

/// A library (a vendor's, HDF5), loaded when it is asked for and never unloaded: a second load of some is known to
/// fail.
class DynamicLibrary {
 public:
  /// The first of the names that can be loaded. @throws RunError with what the loader says of each
  explicit DynamicLibrary(const std::vector<std::string>& names);

  const std::string& name() const { return name_; }
  /// @throws RunError if it has no such function
  template <typename Function>
  void find(Function*& function, const char* symbol) const {
    function = reinterpret_cast<Function*>(address(symbol, true));
  }
  /// Null if it has none.
  template <typename Function>
  void findIfThere(Function*& function, const char* symbol) const {
    function = reinterpret_cast<Function*>(address(symbol, false));
  }

 private:
  void* address(const char* symbol, bool required) const;

  std::string name_;
  void* handle_ = nullptr;
};

}  // namespace palpate
