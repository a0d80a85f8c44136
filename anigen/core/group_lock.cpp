#include "anigen/core/group_lock.h"

#include <chrono>
#include <thread>
#include <utility>

#include "anigen/core/interrupt.h"

namespace anigen {
namespace {

namespace fs = std::filesystem;
using Kind = FileLock::Kind;

FileLock pass_gate(const fs::path& file) { return wait_for_lock(file.string() + "-gate", Kind::kExclusive); }

}  // namespace

FileLock wait_for_lock(const fs::path& file, Kind kind) {
  for (;;) {
    if (std::optional<FileLock> lock = FileLock::try_lock(file, kind)) return std::move(*lock);
    throw_if_interrupted();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

std::optional<FileLock> join_group(const fs::path& file, const std::function<void(bool)>& enter) {
  const FileLock gate = pass_gate(file);
  const bool first = FileLock::try_lock(file, Kind::kExclusive).has_value();
  if (!first && !FileLock::try_lock(file, Kind::kShared)) return std::nullopt;
  enter(first);
  return FileLock::try_lock(file, Kind::kShared);
}

std::optional<FileLock> instead_of_group(const fs::path& file) {
  const FileLock gate = pass_gate(file);
  return FileLock::try_lock(file, Kind::kExclusive);
}

bool while_group_is_empty(const fs::path& file, const std::function<void()>& action) {
  const FileLock gate = pass_gate(file);
  if (!FileLock::try_lock(file, Kind::kExclusive)) return false;
  action();
  return true;
}

}  // namespace anigen
