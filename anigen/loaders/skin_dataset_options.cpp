#include "anigen/loaders/skin_dataset_options.h"

namespace anigen::loaders {

SkinDatasetOptions SkinDatasetOptions::read(ConfigReader& reader) {
  SkinDatasetOptions options;
  options.read_common(reader);
  options.memory_budget_mb = reader.integer("memory_budget_mb", 8192, 0, 1 << 24);
  options.filter.max_num_voxels = reader.integer("max_num_voxels", 32768, 0);
  options.filter.drop_bad_skin = reader.boolean("filter_bad_skin", false);
  const bool test_mode = reader.boolean("test_mode", true), is_test = reader.boolean("is_test", false);
  if (test_mode) options.filter.is_test = is_test;
  if (reader.boolean("skin_accum_as_flow", false)) {
    throw NotSupportedError(reader.file(), reader.pointer_to("skin_accum_as_flow"), "skin_accum_as_flow");
  }
  for (const char* unused :
       {"image_size", "model", "resolution", "load_cubvh", "skl_dilation_iter", "skl_dilation_random_aug",
        "skl_dilation_random_aug_prob", "joint_merge_res", "bucket_by_voxels"}) {
    reader.raw(unused);
  }
  return options;
}

Augmentations read_augmentations(ConfigReader reader) {
  Augmentations options;
  const std::string rotation = reader.choice("rotation", "none", {"none", "z", "so3"});
  options.rotation = rotation == "z"     ? Augmentations::Rotation::kAboutZ
                     : rotation == "so3" ? Augmentations::Rotation::kAny
                                         : Augmentations::Rotation::kNone;
  options.anisotropic_scale = reader.number("anisotropic_scale", 0.0, 0.0, 3.0);
  options.random_pose = reader.number("random_pose", 0.0, 0.0, 180.0);
  options.joint_jitter = reader.number("joint_jitter", 0.0, 0.0, 10.0);
  options.merge_joints = reader.number("merge_joints", 0.0, 0.0, 1.0);
  options.drop_leaves = reader.number("drop_leaves", 0.0, 0.0, 1.0);
  options.blend_sampling = reader.number("blend_sampling", 0.0, 0.0, 1.0);
  options.sharpen = reader.number("sharpen", 0.0, 0.0, 3.0);
  reader.finish();
  return options;
}

}  // namespace anigen::loaders
