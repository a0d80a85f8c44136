#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/augment.h"
#include "anigen/loaders/metadata.h"

namespace anigen::loaders {

/// `dataset.args` of AniGenSparseFeat2Skeleton as far as the skin auto-encoder needs them (reference
/// training-and-data.md, section 1.4). The arguments about images, features and voxels are accepted and not used:
/// the published class loads those files and its first stage never looks at them.
struct SkinDatasetOptions {
  std::string data_dir;        ///< ours: comma-separated roots; --data-dir sets it
  std::string split;           ///< ours: file of ids to use; relative to the first root, else to the working directory
  std::string eval_split;      ///< ours: file of ids held out for evaluation; never trained on
  double eval_fraction = 0.0;  ///< ours, without eval_split: this share of the ids, chosen by a hash of the id
  bool skip_broken = false;    ///< ours: leave out assets that cannot be read
  std::int64_t memory_budget_mb = 8192;  ///< ours: assets kept in memory
  RowFilter filter;  ///< ours: `repeat_sources`, for example {"real": 8}, visits assets of a source that often an epoch

  /// @throws InputError; NotSupportedError for skin_accum_as_flow
  static SkinDatasetOptions read(ConfigReader& reader);
};

struct TrainAndEval {
  std::vector<AssetId> train, eval;
};

/// Applies filters and splits. @throws InputError when nothing is left to train on, or a held-out split is empty
TrainAndEval select(const SkinDatasetOptions& options);

/// `augmentations` of the skin auto-encoder's trainer. @throws InputError
Augmentations read_augmentations(ConfigReader reader);

}  // namespace anigen::loaders
