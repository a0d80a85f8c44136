#include "anigen/loaders/datasets/latent_dataset_options.h"

#include "anigen/core/random.h"
#include "anigen/loaders/ragged_voxels.h"

namespace anigen::loaders {

namespace fs = std::filesystem;

fs::path condition_folder(const AssetId& asset) { return asset.root / "renders_cond" / asset.id; }

void LatentDatasetOptions::read_latents(ConfigReader& reader, bool conditioned, const std::string& flag) {
  image_conditioned = conditioned;
  sources.read_common(reader);
  reader.require("latent_model");
  latent_model = reader.text("latent_model", "");
  if (image_conditioned) {
    image_size = static_cast<int>(reader.integer("image_size", 518, 1, 4096));
    const bool normals = reader.choice("condition", "color", {"color", "normal"}) == "normal";
    condition = normals ? ConditionPictures::kNormals : ConditionPictures::kColor;
  }
  RowFilter& filter = sources.filter;
  filter.required_flags = {flag + latent_model};
  if (image_conditioned) filter.required_flags.push_back("cond_rendered");
  filter.drop_bad_skin = true;
}

void LatentDatasetOptions::append_condition_files(const AssetId& asset, std::vector<fs::path>& files) const {
  if (!image_conditioned) return;
  files.push_back(condition_folder(asset) / "transforms.json");
  // Views are colour first, normals only when asked for: often a dataset has none.
  if (condition == ConditionPictures::kNormals) files.push_back(first_normal_picture(condition_folder(asset)));
}

std::vector<float> LatentDatasetOptions::condition_picture(const AssetId& asset, std::uint64_t seed,
                                                           std::uint64_t position) const {
  if (!image_conditioned) return {};
  Rng view(seed, "condition view", position);
  return read_condition_image(condition_folder(asset), image_size, view, condition);
}

torch::Tensor LatentDatasetOptions::condition_batch(const std::vector<const std::vector<float>*>& pictures,
                                                    const std::vector<std::string>& ids) const {
  if (!image_conditioned) return {};
  return stack(pictures, {3, image_size, image_size}, ids, "cond");
}

}  // namespace anigen::loaders
