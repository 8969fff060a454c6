#include "palpate/record/space_reserve.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <system_error>
#include <utility>

#include "palpate/common/interruption.h"

namespace palpate {

SpaceReserve::SpaceReserve(std::filesystem::path file, std::uintmax_t bytes) : file_(std::move(file)) {
  std::error_code unknown;
  const std::uintmax_t free = std::filesystem::space(file_.parent_path(), unknown).available;
  const std::uintmax_t wanted = unknown ? 0 : std::min(bytes, free / 4);
  if (wanted == 0) return;
  markProvisional(file_);
  const int descriptor = ::open(file_.c_str(), O_CREAT | O_WRONLY | O_TRUNC | O_CLOEXEC, 0600);
  if (descriptor >= 0 && ::posix_fallocate(descriptor, 0, static_cast<off_t>(wanted)) == 0) bytes_ = wanted;
  if (descriptor >= 0) ::close(descriptor);
  if (bytes_ == 0) release();
}

void SpaceReserve::release() noexcept {
  if (file_.empty()) return;
  ::unlink(file_.c_str());
  unmarkProvisional(file_);
  file_.clear();
  bytes_ = 0;
}

}  // namespace palpate
