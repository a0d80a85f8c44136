#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/prepare/merge.h"
#include "anigen/prepare/run.h"
#include "anigen/prepare/sources.h"
#include "anigen/prepare/steps.h"

namespace anigen::prepare {

/// Tables of the finished dataset; may be changed without making any of them again.
struct TableOptions {
  SplitOptions split;
  QualityLimits limits;
  NearSkeletons near_skeletons = NearSkeletons::kFlag;
};

struct PrepareOptions {
  std::filesystem::path out;
  std::vector<AssetSource> sources;  ///< of all shards
  StepPlan plan;
  TableOptions tables;
  RunOptions run;
};

struct PrepareSummary {
  std::size_t real = 0, procedural = 0;  ///< sources in the dataset
  std::size_t variants = 0, rejected_poses = 0;
  std::size_t reused = 0;  ///< sources for which nothing had to be made
  std::size_t bad_skeleton = 0, bad_skin = 0, train = 0, test = 0;
  std::size_t failed_steps = 0;
  std::uintmax_t bytes = 0;  ///< of all outputs
  bool merged = true;        ///< false: one shard of several; the tables are made by merge_dataset()
  std::vector<Rejected> rejected;
  std::map<std::string, StepCost> costs;  ///< of the steps that this run did

  std::size_t prepared() const { return real + procedural; }
};
ANIGEN_JSON_RECORD(PrepareSummary, real, procedural, reused, variants, rejected_poses, bad_skeleton, bad_skin, train,
                   test, failed_steps, bytes, merged, rejected)

/// Turns sources into a dataset in the published layout (docs/reference/training.md, 1.1; datasets/README.md):
///
///     metadata.csv  rejected.csv  failures.jsonl  splits/*.txt  card.html  card.md  card.png
///     skeleton/<id>/skeleton_voxelized.npz  voxels/<id>.ply  voxels/<id>_skeleton.ply  assets/<id>.glb
///     renders/<id>/  renders_cond/<id>/  features/<model>/<id>.npz  records/<id>.json
///     run/    locks, leases, failures, timings and lists per shard: about the run, not part of the dataset
///
/// Every step of every asset is written by rename and recorded; what is recorded under the same content, options and
/// version is not made again. So a call that ended in whatever way can be repeated, and the dataset that comes out
/// (all but run/) has the same bytes however often that happened, on however many workers and shards. metadata.csv
/// names exactly the sources of this call, in their order; columns that other programs added to it stay
/// (carry_over_columns). What cannot be used, or repeats an earlier source, goes to rejected.csv; only usable assets
/// enter the splits.
///
/// Any number of processes, on any machines that share the folder, may be called alike at any time: they share the work
/// by leases (core/lease.h), take over what a dead one had, and all return when everything is done; one of them checks
/// that nothing is missing (merge.h) and writes the tables.
///
/// A shard only takes its own sources through the steps; merge_dataset() makes the tables when all have finished.
/// @throws InputError when not one source could be used, or the dataset is in other use; Interrupted after Ctrl-C;
/// Error when the disk refuses, or assets are not complete in the end
PrepareSummary prepare_dataset(const PrepareOptions& options);

/// The tables, splits and card of a dataset whose shards have all finished, from their lists and the records alone,
/// after a check that every asset is complete. @throws InputError naming the shards that are missing, Error naming
/// assets that are not complete
PrepareSummary merge_dataset(const std::filesystem::path& out);

/// A dataset of procedural creatures whose shards are replaced while trainings read them.
struct StreamOptions {
  PrepareOptions shard;  ///< steps and tables of each; `out` is the folder of the stream; no sources
  std::uint64_t seed = 0;
  std::size_t creatures = 0;  ///< of a shard
  std::size_t shards = 4;     ///< that trainings read at a time; at most two more are on the disk
  std::uint64_t end = 0;      ///< number of shards after which to stop, with the first ones; 0: never
  /// Programs that add to a finished shard before it is shown, such as anigen-encode; its folder follows as the last
  /// word.
  std::vector<std::vector<std::string>> commands;
  std::map<std::string, std::string> encoders;  ///< run folders that the commands use, which a stream keeps to
};

/// Makes the shards of a stream (core/run_folder.h) one after the other, each as prepare_dataset() does in a hidden
/// folder that is renamed when all is there, until there are StreamOptions::end of them or an interrupt. The first
/// generation is shown when it is whole; then a shard is made ahead and takes the place of the oldest as soon as a
/// training has a checkpoint of the generation that is there. The same call goes on after whatever end.
/// @return how many shards have been made, by this call and earlier ones
/// @throws InputError when another process makes shards there, or the stream has begun with other options; Interrupted;
/// Error when a command fails; as prepare_dataset()
std::uint64_t stream_dataset(const StreamOptions& options);

/// All of it, with the costs.
Json to_json(const PrepareSummary& summary);
/// A few lines for the screen.
std::string to_text(const PrepareSummary& summary);

}  // namespace anigen::prepare
