#include "anigen/core/file_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>

#include "anigen/core/error.h"

namespace anigen {

std::optional<FileLock> FileLock::try_lock(const std::filesystem::path& file, Kind kind) {
  if (file.has_parent_path()) {
    std::error_code error;
    std::filesystem::create_directories(file.parent_path(), error);
    if (error) throw Error(file.parent_path().string() + ": cannot create folder: " + error.message());
  }
  const int descriptor = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (descriptor < 0) throw Error(file.string() + ": cannot open: " + std::strerror(errno));
  const int operation = kind == Kind::kShared ? LOCK_SH : LOCK_EX;
  if (::flock(descriptor, operation | LOCK_NB) == 0) return FileLock(descriptor);
  const int reason = errno;
  ::close(descriptor);
  if (reason == EWOULDBLOCK) return std::nullopt;
  if (reason == ENOSYS || reason == EOPNOTSUPP || reason == ENOLCK) {
    throw NotSupportedError(file.string(), "", "locks (flock) by the file system of this folder");
  }
  throw Error(file.string() + ": cannot lock: " + std::strerror(reason));
}

FileLock::~FileLock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

std::filesystem::path dataset_lock_file(const std::filesystem::path& root) { return root / "run" / "lock"; }

std::filesystem::path dataset_prepare_lock_file(const std::filesystem::path& root) {
  return root / "run" / "lock-prepare";
}

}  // namespace anigen
