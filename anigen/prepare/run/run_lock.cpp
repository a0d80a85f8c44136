#include "anigen/prepare/run/run_lock.h"

#include <cctype>
#include <system_error>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::prepare {
namespace {

namespace fs = std::filesystem;

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

RunLock::RunLock(const fs::path& out, const Shard& shard)
    : dataset_(FileLock::try_lock(dataset_lock_file(out),
                                  shard.whole() ? FileLock::Kind::kExclusive : FileLock::Kind::kShared)) {
  if (!dataset_) {
    throw InputError(out.string(), "", "another anigen-prepare, or an anigen-encode, is working on this dataset");
  }
  if (shard.whole()) return;
  shard_ = FileLock::try_lock(run_folder(out) / ("lock-" + shard.name()), FileLock::Kind::kExclusive);
  if (!shard_) throw InputError(out.string(), "", "another anigen-prepare is working on shard " + shard.name());
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
