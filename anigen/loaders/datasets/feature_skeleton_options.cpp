#include "anigen/loaders/datasets/feature_skeleton_options.h"

#include "anigen/loaders/files/pooled_voxels.h"

namespace anigen::loaders {

FeatureSkeletonOptions FeatureSkeletonOptions::read(ConfigReader& reader) {
  FeatureSkeletonOptions options;
  options.sources.read_common(reader);
  reader.require("image_size");
  options.image_size = static_cast<int>(reader.integer("image_size", 518, 1, 4096));
  options.model = reader.text("model", options.model);
  options.resolution = static_cast<int>(reader.integer("resolution", kStoredResolution, 1, kStoredResolution));
  if (kStoredResolution % options.resolution != 0) throw reader.error("resolution", "must divide 64");
  options.load_cubvh = reader.boolean("load_cubvh", false);
  options.skl_dilation_iter = static_cast<int>(reader.integer("skl_dilation_iter", 0, 0, kMostResolution));
  options.skl_dilation_random_aug = reader.boolean("skl_dilation_random_aug", false);
  options.skl_dilation_random_aug_prob = reader.number("skl_dilation_random_aug_prob", 0.5, 0.0, 1.0);
  options.skin_accum_as_flow = reader.boolean("skin_accum_as_flow", false);
  reader.ignore("joint_merge_res");
  options.bucket_by_voxels = reader.boolean("bucket_by_voxels", false);
  options.memory_budget_mb = reader.integer("memory_budget_mb", 8192, 0, 1 << 24);

  RowFilter& filter = options.sources.filter;
  filter.required_flags = {"feature_" + options.model};
  filter.required_columns = {"is_bad_skin"};
  filter.max_num_voxels = reader.integer("max_num_voxels", 32768, 0);
  filter.drop_bad_skin = reader.boolean("filter_bad_skin", false);
  const bool test_mode = reader.boolean("test_mode", true), is_test = reader.boolean("is_test", false);
  if (test_mode) filter.is_test = is_test;
  return options;
}

}  // namespace anigen::loaders
