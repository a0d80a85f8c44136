#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/io/arrays/ndarray.h"

namespace anigen::train {

/// State besides weights that lets a run go on bit for bit: arrays (moments, norms, generator) and numbers.
struct SavedState {
  io::NamedArrays arrays;
  Json numbers = Json::object();  ///< doubles survive exactly; infinities must be written as null
};

/// Weight files of one checkpoint: name without the step ("model", "model_ema0.9999") and tensors.
using WeightFiles = std::vector<std::pair<std::string, io::NamedArrays>>;

/// The `ckpts/` folder of a run: `<name>_step0000100.safetensors` per weight file and `state_step0000100.safetensors`,
/// which is written last, lists the others with their sizes, and thereby makes the set valid. A set without it, or
/// with a listed file missing or of another size, does not exist as far as reading goes.
class CheckpointFolder {
 public:
  /// @param kept step whose set save() leaves although there are two newer ones; 0: none
  explicit CheckpointFolder(std::filesystem::path folder, std::int64_t kept = 0)
      : folder_(std::move(folder)), kept_(kept) {}

  /// Writes a set; every file is written to a temporary name, fsynced and renamed. Then deletes what the rule of the
  /// published trainer does not keep: all but the two newest steps and multiples of 100,000
  /// (docs/reference/training.md, 2.4), and leftovers of sets that were never finished. The set just written is one of
  /// the two; sets of later steps neither count nor go. @throws Error when the set is not complete afterwards
  void save(std::int64_t step, const WeightFiles& weights, const SavedState& state) const;

  /// Steps of complete sets, ascending.
  std::vector<std::int64_t> steps() const;
  /// Newest complete set.
  std::optional<std::int64_t> latest() const;
  /// Reads the state's header, none of its arrays, and compares the sizes of files.
  bool complete(std::int64_t step) const;
  /// There is the state of some set, complete or not.
  bool holds_states() const { return !stated_steps().empty(); }

  /// @throws InputError when the file is missing or damaged
  io::NamedArrays weights(const std::string& name, std::int64_t step) const;
  bool has(const std::string& name, std::int64_t step) const;
  SavedState state(std::int64_t step) const;

  std::filesystem::path file(const std::string& name, std::int64_t step) const;

 private:
  std::vector<std::int64_t> stated_steps() const;
  void clean_up(std::int64_t newest) const;

  std::filesystem::path folder_;
  std::int64_t kept_;
};

/// Moves what a run folder holds of the steps after `last` into a new folder `ckpts/abandoned-<first step>-<n>`, out of
/// the way of a run that begins again at `last`: files of checkpoints, folders of `samples/`, and the rows of
/// `metrics.csv`. Nothing is deleted. The new folder can be loaded like a run folder.
/// @return the new folder; nothing when there was nothing to move @throws Error when the disk refuses; InputError when
/// metrics.csv is no such table, before anything is moved
std::optional<std::filesystem::path> set_later_steps_aside(const std::filesystem::path& run, std::int64_t last);

/// The folder of a run's checkpoints: its `ckpts/`, or itself where it has none (see set_later_steps_aside()).
std::filesystem::path checkpoint_files_of(const std::filesystem::path& run);

/// Name of an averaged model's files: "model_ema0.9999".
std::string ema_name(const std::string& model, double rate);

/// State of LibTorch's own generator on the CPU, which some baselines draw from, as bytes.
std::string generator_state();

}  // namespace anigen::train
