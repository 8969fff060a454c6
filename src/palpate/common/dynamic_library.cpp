#include "palpate/common/dynamic_library.h"

#include <dlfcn.h>

#include "palpate/common/error.h"

namespace palpate {

DynamicLibrary::DynamicLibrary(const std::vector<std::string>& names) {
  std::string reasons;
  for (const std::string& name : names) {
    handle_ = ::dlopen(name.c_str(), RTLD_LAZY | RTLD_GLOBAL);  // NOLINT(concurrency-mt-unsafe): while nothing runs
    name_ = name;
    if (handle_ != nullptr) return;
    const char* why = ::dlerror();  // NOLINT(concurrency-mt-unsafe)
    reasons += (reasons.empty() ? "" : "; ") + std::string(why ? why : name + " cannot be loaded");
  }
  throw RunError(reasons);
}

void* DynamicLibrary::address(const char* symbol, bool required) const {
  void* found = ::dlsym(handle_, symbol);
  if (found == nullptr && required) throw RunError(name_ + " has no function " + symbol + ": is it the right library?");
  return found;
}

}  // namespace palpate
