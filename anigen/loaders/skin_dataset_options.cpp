#include "anigen/loaders/skin_dataset_options.h"

#include <filesystem>
#include <set>
#include <system_error>

#include "anigen/core/random.h"

namespace anigen::loaders {
namespace {

namespace fs = std::filesystem;

fs::path split_file(const std::string& name, const std::string& data_dir) {
  const fs::path below_root = fs::path(data_dir.substr(0, data_dir.find(','))) / name;
  std::error_code error;
  return fs::exists(below_root, error) ? below_root : fs::path(name);
}

double place_of(const std::string& id) { return static_cast<double>(stable_hash(id) >> 11) * 0x1.0p-53; }

}  // namespace

SkinDatasetOptions SkinDatasetOptions::read(ConfigReader& reader) {
  SkinDatasetOptions options;
  options.data_dir = reader.text("data_dir", "");
  options.split = reader.text("split", "");
  options.eval_split = reader.text("eval_split", "");
  options.eval_fraction = reader.number("eval_fraction", 0.0, 0.0, 0.9);
  options.skip_broken = reader.boolean("skip_broken", false);
  options.memory_budget_mb = reader.integer("memory_budget_mb", 8192, 0, 1 << 24);
  options.filter.min_aesthetic_score = reader.number("min_aesthetic_score", 5.0);
  options.filter.max_num_voxels = reader.integer("max_num_voxels", 32768, 0);
  options.filter.drop_bad_skin = reader.boolean("filter_bad_skin", false);
  const bool test_mode = reader.boolean("test_mode", true), is_test = reader.boolean("is_test", false);
  if (test_mode) options.filter.is_test = is_test;
  if (reader.boolean("skin_accum_as_flow", false)) {
    throw NotSupportedError(reader.file(), reader.pointer_to("skin_accum_as_flow"), "skin_accum_as_flow");
  }
  ConfigReader repeat = reader.object("repeat_sources");
  if (const Json* sources = reader.raw("repeat_sources"); sources != nullptr && sources->is_object()) {
    for (const auto& source : sources->items()) {
      options.filter.repeat[source.key()] = static_cast<std::size_t>(repeat.integer(source.key(), 1, 1, 10000));
    }
  }
  repeat.finish();
  for (const char* unused : {"image_size", "model", "resolution", "load_cubvh", "skl_dilation_iter",
                             "skl_dilation_random_aug", "skl_dilation_random_aug_prob", "joint_merge_res"}) {
    reader.raw(unused);
  }
  return options;
}

TrainAndEval select(const SkinDatasetOptions& options) {
  RowFilter filter = options.filter;
  TrainAndEval result;
  std::set<std::string> held_out;
  if (!options.eval_split.empty()) {
    held_out = read_split(split_file(options.eval_split, options.data_dir));
    RowFilter evaluated = filter;
    evaluated.only = held_out;
    evaluated.repeat.clear();
    result.eval = select_assets(options.data_dir, evaluated);
  }
  if (!options.split.empty()) filter.only = read_split(split_file(options.split, options.data_dir));
  for (const AssetId& asset : select_assets(options.data_dir, filter)) {
    if (held_out.count(asset.id) > 0) continue;
    const bool chosen = options.eval_split.empty() && place_of(asset.id) < options.eval_fraction;
    (chosen ? result.eval : result.train).push_back(asset);
    if (chosen) result.eval.back().repeat = 1;
  }
  if (result.train.empty()) {
    throw InputError(options.data_dir, "split", "every asset is held out for evaluation; none is left to train on");
  }
  if (options.eval_fraction > 0.0 && result.eval.empty()) {
    throw InputError(options.data_dir, "eval_fraction",
                     "holds out none of " + std::to_string(result.train.size()) + " assets");
  }
  return result;
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
