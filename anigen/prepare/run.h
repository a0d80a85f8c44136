#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/process.h"
#include "anigen/prepare/manifest.h"
#include "anigen/prepare/metadata.h"
#include "anigen/prepare/steps.h"

namespace anigen::prepare {

/// Joins the processes that make a dataset, while the lock lives: all that call this with the same sources, settings
/// and number of shards may be at work at the same time, come and go. Others are refused, and so is anigen-encode
/// meanwhile. Worker processes do not inherit the membership.
///
/// The first one begins the run: it sweeps what killed processes left, and forgets which pieces are done, so that
/// everything is looked at again. Tasks of one SLURM array are one run: a task that begins when the others have ended
/// goes on where they were.
/// @param run without entries @throws InputError when anigen-encode works there, or anigen-prepare on other sources or
/// with other options
[[nodiscard]] FileLock join_run(const std::filesystem::path& out, const Manifest& run);

/// Takes a dataset for oneself, as a merge wants it. @throws InputError when another process is at work there
[[nodiscard]] FileLock take_alone(const std::filesystem::path& out);

/// Folder of the files of a run that are not part of the dataset: locks, leases, failures, timings, lists of what each
/// shard made.
std::filesystem::path run_folder(const std::filesystem::path& out);
/// Leases on the pieces of a run.
std::filesystem::path leases_folder(const std::filesystem::path& out);
/// Mark that the tables of a shard's run are written.
std::filesystem::path finished_file(const std::filesystem::path& out, const Shard& shard);

/// Removes the temporary files that killed processes left in a dataset (see AtomicFile), at any depth. Only while
/// nobody writes there. @return how many
std::size_t sweep_temporary_files(const std::filesystem::path& out);

/// Options of the work; nothing of it shows in the dataset.
struct RunOptions {
  Shard shard;
  std::vector<std::string> worker_command;  ///< empty: in this process, on its threads, without limits
  std::size_t workers = 0;                  ///< processes; 0: as many as threads
  double timeout = 0;                       ///< seconds for one asset; 0: none
  std::uint64_t memory_bytes = 0;           ///< in RAM, per worker; 0: no limit
  bool retry_failed = false;                ///< try again what failed in the same way before
  std::string log_level = "warn";           ///< of workers
  FeatureExtractorFactory features;         ///< for work in this process; workers make their own
};

/// Takes the sources of the shard through the plan, by worker processes or in this process, together with whoever else
/// runs the same: each takes by lease what nobody has or has done. First all are identified, then each content is
/// prepared once; both end when the last process has finished its part.
/// @return what became of them, by whomever, in order of their numbers
/// @pre the caller belongs to the run (join_run())
/// @throws Interrupted after Ctrl-C, Error when the disk refuses
std::vector<SourceOutcome> run_sources(const std::filesystem::path& out, const std::vector<AssetSource>& sources,
                                       const StepPlan& plan, const RunOptions& options, FailureLog& failures,
                                       TimingLog& timings);

}  // namespace anigen::prepare
