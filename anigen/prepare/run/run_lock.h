#pragma once
#include <filesystem>

#include "anigen/core/file_lock.h"
#include "anigen/prepare/run/manifest.h"

namespace anigen::prepare {

/// Being one of the processes that make a dataset: all that are called with the same sources, settings and number of
/// shards may be at work at the same time, come and go. Others are refused, and so is anigen-encode meanwhile.
///
/// The first one begins the run: it sweeps what killed processes left, and forgets which pieces are done, so that
/// everything is looked at again. Tasks of one SLURM array are one run: a task that begins when the others have ended
/// goes on where they were. Worker processes do not inherit the membership.
class RunMembership {
 public:
  /// @param run without entries @throws InputError when anigen-encode works there, or anigen-prepare on other sources
  /// or with other options
  RunMembership(const std::filesystem::path& out, const Manifest& run);

 private:
  FileLock lock_;
};

/// Has a dataset to itself, as a merge wants it. @throws InputError when another process is at work there
class RunAlone {
 public:
  explicit RunAlone(const std::filesystem::path& out);

 private:
  FileLock lock_;
};

/// Where a run keeps what is not part of the dataset: locks, leases, failures, timings, lists of what each shard made.
std::filesystem::path run_folder(const std::filesystem::path& out);
/// Leases on the pieces of a run.
std::filesystem::path leases_folder(const std::filesystem::path& out);
/// What says that the tables of a shard's run are written; see finished_run.h.
std::filesystem::path finished_file(const std::filesystem::path& out, const Shard& shard);

/// Removes the temporary files that killed processes left in a dataset (see AtomicFile), at any depth. Only while
/// nobody writes there. @return how many
std::size_t sweep_temporary_files(const std::filesystem::path& out);

}  // namespace anigen::prepare
