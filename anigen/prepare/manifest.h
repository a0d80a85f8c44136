#pragma once
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/prepare/prepare_source.h"
#include "anigen/prepare/sources.h"

namespace anigen::prepare {

/// One part of a run that is spread over several machines: the sources whose number is `index` modulo `count`.
struct Shard {
  std::size_t index = 0, count = 1;

  bool whole() const { return count == 1; }
  bool owns(std::size_t source) const { return source % count == index; }
  /// "0-of-1", as file names of the run folder carry it.
  std::string name() const { return std::to_string(index) + "-of-" + std::to_string(count); }
  bool operator==(const Shard& other) const { return index == other.index && count == other.count; }
};

/// "i/n" with 0 ≤ i < n. @throws InputError naming --shard
Shard parse_shard(const std::string& text);

/// Failures by the source's file_identifier.
using KnownFailures = std::map<std::string, std::vector<StepFailure>>;

/// One source as the merge needs it.
struct ManifestEntry {
  std::size_t number = 0;  ///< of the source among all of the run
  AssetSource source;
  std::string id;                     ///< empty when it could not be identified
  std::string aesthetic_score;        ///< as its own dataset says; empty: it says nothing
  std::vector<StepFailure> failures;  ///< of the source and its variants
};
ANIGEN_JSON_RECORD(ManifestEntry, number, source, id, aesthetic_score, failures)

/// run/failures-<i>-of-<n>.jsonl: one line per failure with source, id, variant, step, reason. While the run goes on
/// every process appends to a file of its own, failures-<i>-of-<n>-<process>.jsonl, so that what a killed run found out
/// is not found out again; finish() puts one file in their place.
class FailureLog {
 public:
  /// Opens this process' file. @throws Error when it cannot be written
  FailureLog(const std::filesystem::path& out, const Shard& shard);
  ~FailureLog();
  FailureLog(const FailureLog&) = delete;
  FailureLog& operator=(const FailureLog&) = delete;

  void add(const AssetSource& source, const StepFailure& failure);
  /// Replaces the files of all processes by one with the failures of these sources, in order.
  void finish(const std::vector<ManifestEntry>& entries);

  /// Failures of all shards so far; a line that a kill cut off is left out.
  static KnownFailures read(const std::filesystem::path& out);

 private:
  std::filesystem::path out_;
  std::string name_;
  std::filesystem::path file_;
  std::FILE* stream_ = nullptr;
  std::size_t count_ = 0;
};

/// The line, without its end.
std::string failure_line(const AssetSource& source, const StepFailure& failure);

/// Cost of a step over all assets of a run.
struct StepCost {
  std::vector<double> seconds;
  std::uint64_t peak_bytes = 0;
};

/// run/timings-<i>-of-<n>-<process>.csv: id, variant, step, seconds, peak_mb, a line per step that this process did.
/// Not part of the dataset: two equal runs differ in it.
class TimingLog {
 public:
  /// @throws Error when the file cannot be written
  TimingLog(const std::filesystem::path& out, const Shard& shard);
  ~TimingLog();
  TimingLog(const TimingLog&) = delete;
  TimingLog& operator=(const TimingLog&) = delete;

  void add(const SourceOutcome& outcome);
  /// Of this run, by step.
  const std::map<std::string, StepCost>& costs() const { return costs_; }

 private:
  std::FILE* stream_ = nullptr;
  std::map<std::string, StepCost> costs_;
};

/// A table with assets, mean, median, 95th percentile, total seconds and peak memory per step; empty without steps.
std::string to_text(const std::map<std::string, StepCost>& costs);
Json to_json(const std::map<std::string, StepCost>& costs);

/// aesthetic_score of sources that are assets of another published-layout dataset. Reads each dataset's metadata.csv
/// once.
class SourceScores {
 public:
  /// @return the cell as it stands; empty when there is none, or it is no number
  std::string of(const AssetSource& source);

 private:
  std::map<std::filesystem::path, std::map<std::string, std::string>> by_dataset_;
};

/// Report of a finished shard for the merge, run/sources-<i>-of-<n>.jsonl: how the run was set up, then a line for
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

/// Removes what earlier runs of other sources, settings or numbers of shards left, and this shard's own: what the next
/// merge finds is of this run.
void remove_other_manifests(const std::filesystem::path& out, const Manifest& of_this_run);

/// The manifests of every shard of the run that worked here last, in order of their shards. @throws InputError naming
/// the shards that have not finished, or when shards disagree about the run
std::vector<Manifest> read_manifests(const std::filesystem::path& out);

}  // namespace anigen::prepare
