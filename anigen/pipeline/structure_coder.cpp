#include "anigen/pipeline/structure_coder.h"

#include <memory>

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"
#include "anigen/core/sha256.h"
#include "anigen/pipeline/latent_files.h"
#include "anigen/pipeline/latent_manifest.h"

namespace anigen::pipeline {
namespace {

using torch::Tensor;

loaders::SparseStructureOptions occupancy_options(const models::RunModel& encoder) {
  ConfigReader top(encoder.run, encoder.config.string());
  ConfigReader args = top.object("dataset").object("args");
  loaders::SparseStructureOptions options;
  options.resolution = static_cast<int>(args.integer("resolution", 64, 1, 256));
  options.skl_dilation_iter = static_cast<int>(args.integer("skl_dilation_iter", 0, 0, 256));
  return options;
}

}  // namespace

StructureCoder::StructureCoder(const std::filesystem::path& run, const std::string& ckpt, torch::Device device,
                               bool decodes)
    : device_(device),
      found_(models::find_run_model(run, models::kSparseStructureEncoderClass, ckpt)),
      options_(occupancy_options(found_)),
      encoder_(models::load_sparse_structure_encoder(found_, device)) {
  if (encoder_->options().encode_global || encoder_->options().encode_global_skl) {
    throw NotSupportedError(found_.config.string(), found_.pointer + "/encode_global", "latents of global tokens");
  }
  if (decodes) {
    decoder_ = models::load_sparse_structure_decoder(
        models::find_run_model(run, models::kSparseStructureDecoderClass, ckpt), device);
  }
}

std::string StructureCoder::fingerprint() const {
  return sha256(fingerprint_of_files({found_.checkpoint}) + found_.args.dump() + "/" +
                std::to_string(options_.resolution) + "/" + std::to_string(options_.skl_dilation_iter));
}

loaders::SparseStructureBatch StructureCoder::voxels(const loaders::AssetId& asset) const {
  // One asset: its own errors, and nothing to leave out or replace.
  const loaders::SparseStructureDataset one({asset}, options_, 0);
  const std::unique_ptr<loaders::Batch> batch = one.load({loaders::Draw{0, 0}});
  return dynamic_cast<const loaders::SparseStructureBatch&>(*batch);
}

void StructureCoder::encode(const loaders::SparseStructureBatch& voxels, const std::filesystem::path& file) {
  const auto latent =
      encoder_->forward(voxels.ss.to(device_, torch::kFloat32), voxels.ss_skl.to(device_, torch::kFloat32));
  write_structure_latents(file, latent.mean[0], latent.mean_skl[0], found_.checkpoint);
}

StructureReconstruction StructureCoder::agreement(const loaders::StructureLatent& latent,
                                                  const loaders::SparseStructureBatch& voxels) {
  const auto tensor = [&](const loaders::LatentGrid& grid) {
    const auto& s = grid.shape;
    return torch::tensor(grid.values).view({1, s[0], s[1], s[2], s[3]}).to(device_);
  };
  const auto logits = decoder_->forward(tensor(latent.mean), tensor(latent.mean_skl));
  const auto of = [](const Tensor& grid, const Tensor& truth) {
    return models::voxel_agreement((grid[0][0] > 0).to(torch::kCPU), truth[0][0] > 0);
  };
  return {of(logits.shape, voxels.ss), of(logits.skeleton, voxels.ss_skl)};
}

}  // namespace anigen::pipeline
