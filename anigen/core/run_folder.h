#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/config.h"

namespace anigen {

/// Names of what is in the folder of a run of anigen-train, or of a published one.
struct RunFolder {
  std::filesystem::path root;

  std::filesystem::path config() const { return root / "config.json"; }  ///< resolved
  std::filesystem::path checkpoints() const { return root / "ckpts"; }
  std::filesystem::path metrics() const { return root / "metrics.csv"; }
  std::filesystem::path samples() const { return root / "samples"; }
  std::filesystem::path board() const { return root / "tb_logs"; }  ///< TensorBoard's
  std::filesystem::path command() const { return root / "command.txt"; }
  std::filesystem::path made_by() const { return root / "made_by.json"; }  ///< version, commit, compiler, LibTorch
  std::filesystem::path parameters() const { return root / "parameters.json"; }  ///< numbers of them, by model
  std::filesystem::path log() const { return root / "log.txt"; }
  std::filesystem::path progress() const { return root / "progress.html"; }  ///< curves and samples, for a browser
  std::filesystem::path profile() const { return root / "profile.md"; }
  std::filesystem::path lock() const { return root / "run.lock"; }
  std::filesystem::path restart() const { return root / "restart.json"; }  ///< of a restart under way

  bool has_config() const;
  bool has_checkpoints() const;  ///< a folder of them, perhaps empty
  /// The checkpoints' folder, or the root itself where it has none, such as one that holds nothing else.
  std::filesystem::path checkpoint_files() const { return has_checkpoints() ? checkpoints() : root; }

  /// The run whose folder, or whose ckpts/, a file lies in; nothing without a config.json.
  static std::optional<RunFolder> around(const std::filesystem::path& file);
};

/// Shards of a stream by their numbers, each in its slot: number N is in slot N modulo the number of shards.
struct StreamIndex {
  std::uint64_t generation = 0;       ///< raised with every change; 0: no shard may be read yet
  std::vector<std::uint64_t> shards;  ///< of this generation
  std::vector<std::uint64_t> before;  ///< of the generation before, whose shards stay until this one is in use
  Json settings;                      ///< of the program that makes the shards
};
ANIGEN_JSON_RECORD(StreamIndex, generation, shards, before, settings)

/// A dataset whose shards are replaced while trainings read them (anigen-prepare --stream):
///
///     stream.json    StreamIndex; written by rename
///     used.json      the newest generation of which a training has a checkpoint
///     shard-000012/  a dataset by itself
///     .making-000014/  .retired-000009/  .locks/
///
/// A reader holds the lock of a shard shared. The preparer makes a new generation when the last one is in use, and then
/// removes the shard that fell out, once nobody holds it: what the newest checkpoint of a training has read is there
/// when the training goes on.
struct StreamFolder {
  std::filesystem::path root;

  std::filesystem::path index() const { return root / "stream.json"; }
  std::filesystem::path lock() const { return root / ".locks" / "prepare"; }  ///< of the preparer
  std::filesystem::path shard(std::uint64_t number) const { return root / named("shard-", number); }
  std::filesystem::path making(std::uint64_t number) const { return root / named(".making-", number); }
  std::filesystem::path retired(std::uint64_t number) const { return root / named(".retired-", number); }
  std::filesystem::path shard_lock(std::uint64_t number) const { return root / ".locks" / named("shard-", number); }

  bool exists() const;
  StreamIndex read_index() const;                    ///< @throws InputError when it is damaged
  void write_index(const StreamIndex& index) const;  ///< atomic
  std::uint64_t used_generation() const;             ///< 0: none
  void mark_used(std::uint64_t generation) const;    ///< atomic; an earlier one than is noted changes nothing
  static std::string named(const char* kind, std::uint64_t number);  ///< "shard-000012"
};

}  // namespace anigen
