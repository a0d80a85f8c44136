#pragma once
#include <filesystem>
#include <optional>

#include "anigen/core/file_lock.h"
#include "anigen/prepare/run/shard.h"

namespace anigen::prepare {

/// Keeps two runs from working on the same part of one dataset, by locks on files of <out>/run (core/file_lock.h). A
/// shard shares the dataset with other shards and with anigen-encode; a whole run or a merge has it alone. Worker
/// processes do not inherit it.
class RunLock {
 public:
  /// @throws InputError when another process is at work there
  RunLock(const std::filesystem::path& out, const Shard& shard);

 private:
  std::optional<FileLock> dataset_, shard_;
};

/// Where a run keeps what is not part of the dataset: locks, failures, timings, lists of what each shard made.
std::filesystem::path run_folder(const std::filesystem::path& out);

/// Removes the temporary files that killed processes left in a dataset (see AtomicFile), at any depth. Only for
/// whoever has the dataset alone. @return how many
std::size_t sweep_temporary_files(const std::filesystem::path& out);

}  // namespace anigen::prepare
