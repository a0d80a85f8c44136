#pragma once
#include <cstdint>
#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/loaders/source_options.h"

namespace anigen::loaders {

/// `dataset.args` of AniGenSparseFeat2Skeleton, all of them (reference training-and-data.md, 1.4). Rows need
/// `feature_<model>` and the column `is_bad_skin`; at most `max_num_voxels` voxels, no `is_bad_skeleton`; with
/// `filter_bad_skin` no bad skin; with `test_mode` only rows whose `is_test` equals the argument.
struct FeatureSkeletonOptions {
  SourceOptions sources;
  int image_size = 0;                         ///< edge of the view, pixels; required
  std::string model = "dinov2_vitl14_reg";    ///< folder below features/
  int resolution = 64;                        ///< edge of the voxel grid; below 64 voxels are merged when they are read
  int skl_dilation_iter = 0;                  ///< Chebyshev radius by which skeleton voxels are dilated
  bool skl_dilation_random_aug = false;       ///< see geometry::dilate_randomly
  double skl_dilation_random_aug_prob = 0.5;  ///< of that, per sample
  bool load_cubvh = false;                    ///< hand out a nearest-surface solver per mesh
  bool skin_accum_as_flow = false;            ///< see accumulate_skin_as_flow
  bool bucket_by_voxels = false;              ///< ours: batches of assets with similar numbers of voxels
  std::int64_t memory_budget_mb = 8192;       ///< ours: nearest-surface solvers kept in memory

  /// @throws InputError, also for a resolution that does not divide 64
  static FeatureSkeletonOptions read(ConfigReader& reader);
};

}  // namespace anigen::loaders
