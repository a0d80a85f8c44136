#include "anigen/prepare/run/run_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::prepare {
namespace {

namespace fs = std::filesystem;

/// @return the open file, or -1 when another process holds it
int try_lock(const fs::path& file, int operation) {
  const int descriptor = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (descriptor < 0) throw Error(file.string() + ": cannot open: " + std::strerror(errno));
  if (::flock(descriptor, operation | LOCK_NB) == 0) return descriptor;
  const int reason = errno;
  ::close(descriptor);
  if (reason == EWOULDBLOCK) return -1;
  throw Error(file.string() + ": cannot lock: " + std::strerror(reason));
}

/// "<stem>.tmp-<pid>-<n><extension>"
bool is_temporary(const std::string& name) {
  const std::size_t mark = name.rfind(".tmp-");
  if (mark == std::string::npos) return false;
  std::size_t i = mark + 5;
  const auto digits = [&] {
    const std::size_t first = i;
    while (i < name.size() && std::isdigit(static_cast<unsigned char>(name[i]))) ++i;
    return i > first;
  };
  if (!digits() || i >= name.size() || name[i] != '-') return false;
  ++i;
  return digits() && (i == name.size() || name[i] == '.');
}

}  // namespace

fs::path run_folder(const fs::path& out) { return out / "run"; }

RunLock::RunLock(const fs::path& out, const Shard& shard) {
  std::error_code error;
  fs::create_directories(run_folder(out), error);
  if (error) throw Error(run_folder(out).string() + ": cannot create folder: " + error.message());
  dataset_ = try_lock(run_folder(out) / "lock", shard.whole() ? LOCK_EX : LOCK_SH);
  if (dataset_ < 0) throw InputError(out.string(), "", "another anigen-prepare is working on this dataset");
  if (shard.whole()) return;
  try {
    shard_ = try_lock(run_folder(out) / ("lock-" + shard.name()), LOCK_EX);
    if (shard_ < 0) {
      throw InputError(out.string(), "", "another anigen-prepare is working on shard " + shard.name());
    }
  } catch (...) {
    ::close(dataset_);
    throw;
  }
}

RunLock::~RunLock() {
  if (shard_ >= 0) ::close(shard_);
  if (dataset_ >= 0) ::close(dataset_);
}

std::size_t sweep_temporary_files(const fs::path& out) {
  std::vector<fs::path> stale;
  std::error_code error;
  fs::recursive_directory_iterator entry(out, fs::directory_options::skip_permission_denied, error), end;
  for (; !error && entry != end; entry.increment(error)) {
    std::error_code ignored;
    if (entry->is_regular_file(ignored) && is_temporary(entry->path().filename().string())) {
      stale.push_back(entry->path());
    }
  }
  std::size_t removed = 0;
  for (const fs::path& file : stale) {
    std::error_code ignored;
    removed += fs::remove(file, ignored) ? 1 : 0;
  }
  return removed;
}

}  // namespace anigen::prepare
