#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/batch_source.h"

namespace anigen::loaders {

/// The dataset of a config, and what its splits hold out for evaluation.
struct Datasets {
  std::shared_ptr<const BatchSource> train;
  std::shared_ptr<const BatchSource> eval;  ///< null: nothing is held out
};

/// The dataset a config `{"name": …, "args": {…}}` asks for:
///
/// | name | batches |
/// |---|---|
/// | AniGenSparseStructure | SparseStructureBatch |
/// | AniGenSparseFeat2Skeleton | FeatureSkeletonBatch (the first stage makes its SkinDataset itself) |
/// | AniGenSparseStructureLatent, ImageConditionedAniGenSparseStructureLatent | StructureLatentBatch |
/// | AniGenSLat, AniGenImageConditionedSLat | StructuredLatentBatch |
///
/// @param dataset the object with name and args, which must outlive the call only @param seed of all random draws
/// @throws InputError naming file and pointer: an unknown name with the nearest known one, a bad argument, a filter
/// that leaves nothing, missing files; NotSupportedError for names the published registry lists but does not implement
Datasets make_datasets(ConfigReader dataset, std::uint64_t seed);

/// All names above.
const std::vector<std::string>& dataset_names();

}  // namespace anigen::loaders
