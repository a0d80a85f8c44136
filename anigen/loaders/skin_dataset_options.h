#pragma once
#include <cstdint>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/augment.h"
#include "anigen/loaders/source_options.h"

namespace anigen::loaders {

/// `dataset.args` of AniGenSparseFeat2Skeleton as far as the skin auto-encoder needs them (reference
/// training-and-data.md, section 1.4). The arguments about images, features and voxels are accepted and not used:
/// the published class loads those files and its first stage never looks at them.
struct SkinDatasetOptions : SourceOptions {
  std::int64_t memory_budget_mb = 8192;  ///< ours: assets kept in memory

  /// @throws InputError; NotSupportedError for skin_accum_as_flow
  static SkinDatasetOptions read(ConfigReader& reader);
};

/// `augmentations` of the skin auto-encoder's trainer. @throws InputError
Augmentations read_augmentations(ConfigReader reader);

}  // namespace anigen::loaders
