#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/prepare/run/shard.h"
#include "anigen/prepare/steps/source_outcome.h"

namespace anigen::prepare {

/// One source as the merge needs it.
struct ManifestEntry {
  std::size_t number = 0;  ///< of the source among all of the run
  AssetSource source;
  std::string id;                     ///< empty when it could not be identified
  std::string aesthetic_score;        ///< as its own dataset says; empty: it says nothing
  std::vector<StepFailure> failures;  ///< of the source and its variants
};

/// What a finished shard leaves for the merge, run/sources-<i>-of-<n>.jsonl: how the run was set up, then a line for
/// each source. The facts about assets are in their records.
struct Manifest {
  Shard shard;
  std::size_t sources = 0;     ///< of all shards together
  std::string sources_digest;  ///< of all their names, in order: shards of one run saw the same
  Json settings;               ///< the plan, the limits and the split
  std::vector<ManifestEntry> entries;

  bool same_run(const Manifest& other) const {
    return shard.count == other.shard.count && sources == other.sources && sources_digest == other.sources_digest &&
           settings == other.settings;
  }
};

std::filesystem::path manifest_path(const std::filesystem::path& out, const Shard& shard);
void write_manifest(const std::filesystem::path& out, const Manifest& manifest);  ///< atomic
Manifest read_manifest(const std::filesystem::path& file);

/// Removes what earlier runs of other sources, settings or numbers of shards left, and this shard's own: what the next
/// merge finds is of this run.
void remove_other_manifests(const std::filesystem::path& out, const Manifest& of_this_run);

/// The manifests of every shard of the run that worked here last, in order of their shards. @throws InputError naming
/// the shards that have not finished, or when shards disagree about the run
std::vector<Manifest> read_manifests(const std::filesystem::path& out);

}  // namespace anigen::prepare
