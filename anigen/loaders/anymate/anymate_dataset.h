#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/anymate/anymate_samples.h"
#include "anigen/loaders/batch_source.h"
#include "anigen/loaders/source_options.h"

namespace anigen::loaders {

/// Samples of Anymate, to be collated by whoever trains on them.
struct AnymateDraws : Batch {
  std::vector<models::anymate::AnymateSample> samples;
};

/// `dataset.args` of the class "Anymate" (ours: the released code reads its files by fixed names). Assets come from
/// prepared data sets (data_dir and what goes with it, source_options.h), or from released files.
struct AnymateDatasetOptions : SourceOptions {
  std::vector<std::string> shards, eval_shards;  ///< `.pt` files; given, data_dir is not read
  std::size_t points = 8192;                     ///< of a sample, drawn anew from those of a file that has more
  bool cells = false;                            ///< sets by the trainer: fields of joints need them
  std::size_t min_bones = 1, max_bones = 64, max_joints = 96;  ///< samples outside are left out (released: 9 to 63)

  static AnymateDatasetOptions read(ConfigReader& reader);
};

/// Samples in memory: half a megabyte each with 8,192 points.
class AnymateDataset : public BatchSource {
 public:
  /// @param repeat how often an epoch visits each sample @param points rows of a draw @param seed of their choice
  AnymateDataset(std::vector<models::anymate::AnymateSample> samples, std::vector<std::size_t> repeat,
                 std::size_t points, std::uint64_t seed);

  std::size_t size() const override { return visits_.size(); }
  std::size_t samples() const { return samples_.size(); }
  std::unique_ptr<Batch> load(const std::vector<Draw>& draws) const override;
  /// A sample with its first points.
  models::anymate::AnymateSample sample(std::size_t index) const;

 private:
  std::vector<models::anymate::AnymateSample> samples_;
  std::vector<std::size_t> visits_;
  std::size_t points_;
  std::uint64_t seed_;
};

struct AnymateDatasets {
  std::shared_ptr<const AnymateDataset> train, held_out;  ///< the latter null when nothing is held out
};

/// Reads and converts everything. What has too many or too few joints or bones, or a skeleton that the conversion
/// rejects, is left out, counted and, with debug messages, named.
/// @throws InputError when nothing is left, and for files that cannot be read unless skip_broken
AnymateDatasets open_anymate(const AnymateDatasetOptions& options, std::uint64_t seed);

}  // namespace anigen::loaders
