#include "anigen/pipeline/structured_latent_coder.h"

#include <memory>

#include "anigen/core/config_reader.h"
#include "anigen/core/log.h"
#include "anigen/core/sha256.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/loaders/files/pooled_voxels.h"
#include "anigen/loaders/files/skin_rows.h"
#include "anigen/loaders/ragged_voxels.h"
#include "anigen/loaders/rig_batch.h"
#include "anigen/pipeline/decoded_asset.h"
#include "anigen/pipeline/latent_files.h"
#include "anigen/pipeline/latent_manifest.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;
using sparse::SparseTensor;
using torch::Tensor;

loaders::FeatureSkeletonOptions data_options(const models::RunModel& found) {
  ConfigReader top(found.run, found.config.string());
  ConfigReader args = top.object("dataset").object("args");
  return loaders::FeatureSkeletonOptions::read(args);
}

fs::path feature_file(const loaders::AssetId& asset, const std::string& model) {
  return asset.root / "features" / model / (asset.id + ".npz");
}

SparseTensor sparse_of(const loaders::VoxelRows& rows, const std::string& id, torch::Device device) {
  const loaders::RaggedVoxels voxels = loaders::collate_voxels({&rows}, {id});
  return {sparse::Support::create(voxels.coords, 1), voxels.feats.to(device)};
}

}  // namespace

StructuredLatentCoder::StructuredLatentCoder(const fs::path& run, const std::string& ckpt, torch::Device device,
                                             const std::optional<geometry::MeanShiftOptions>& decodes)
    : device_(device),
      found_(models::find_run_model(run, models::kStructuredLatentEncoderClass, ckpt)),
      data_(data_options(found_)) {
  const models::RunModel decoder = models::find_run_model(run, models::kStructuredLatentDecoderClass, ckpt);
  variant_ = models::variant_of_run(decoder);
  if (variant_.latent_norm == models::LatentNorm::kNone) found_.args["normalize_z"] = false;
  encoder_ = models::load_structured_latent_encoder(found_, device);
  if (decodes && shape_alone()) shape_decoder_ = models::load_structured_latent_decoder(decoder, device);
  if (decodes && !shape_alone()) decoder_.emplace(decoder, device, *decodes);
}

std::string StructuredLatentCoder::fingerprint() const {
  return sha256(fingerprint_of_files({found_.checkpoint}) + found_.args.dump() + "/" + data_.model + "/" +
                std::to_string(data_.skl_dilation_iter) + "/" + std::to_string(data_.load_cubvh) + "/" +
                std::to_string(data_.skin_accum_as_flow) + "/" + std::to_string(data_.resolution) + "/" +
                std::to_string(static_cast<int>(variant_.latent_norm)));
}

std::vector<fs::path> StructuredLatentCoder::files(const loaders::AssetId& asset) const {
  return {feature_file(asset, data_.model), loaders::skeleton_voxel_path(asset), loaders::rig_path(asset)};
}

StructuredLatentCoder::Inputs StructuredLatentCoder::inputs(const loaders::AssetId& asset) const {
  loaders::VoxelRows skeleton;
  skeleton.coords = loaders::read_voxels_at(loaders::skeleton_voxel_path(asset), data_.resolution);
  if (data_.skl_dilation_iter > 0) {
    skeleton.coords = geometry::dilate(skeleton.coords, data_.resolution, data_.skl_dilation_iter);
  }
  loaders::RigArrays rig = loaders::read_rig_arrays(asset);
  const std::size_t unweighted = loaders::normalize_skin_rows(rig.skin, rig.joints.size());
  if (unweighted > 0) {
    log::warn("{}: {} of {} vertices have no weight and follow joint 0, as published", asset.id, unweighted,
              rig.vertices.size());
  }
  if (data_.skin_accum_as_flow) loaders::accumulate_skin_as_flow(rig.skin, rig.parents);
  loaders::RigBatch batch;
  batch.append(rig);

  Inputs inputs;
  inputs.x =
      sparse_of(loaders::read_features_at(feature_file(asset, data_.model), data_.resolution), asset.id, device_);
  inputs.x_skl = sparse_of(skeleton, asset.id, device_);
  inputs.rigs.joints = {batch.joints.front().to(device_)};
  inputs.rigs.parents = {batch.parents.front().to(device_)};
  inputs.rigs.skin = {batch.skin.front().to(device_)};
  inputs.rigs.vertices = batch.vertices;
  inputs.rigs.faces = batch.faces;
  if (data_.load_cubvh) {
    inputs.rigs.surfaces = {std::make_shared<const geometry::NearestSurface>(rig.vertices, rig.faces)};
  }
  return inputs;
}

models::PerStream<SparseTensor> StructuredLatentCoder::encode(const Inputs& inputs) {
  const torch::NoGradGuard no_grad;
  const auto latents = encoder_->forward(inputs.x, inputs.x_skl, inputs.rigs);
  const models::StructuredLatentEncoderOptions& options = encoder_->options();
  return {latents.z.with(latents.z_geometry),
          latents.z.with(models::renormalized(latents.z_skin, options, variant_.latent_norm)),
          latents.z_skl.with(models::renormalized(latents.z_skl.feats, options, variant_.latent_norm))};
}

RigDecoder::Decoded StructuredLatentCoder::decode(const models::PerStream<SparseTensor>& latents,
                                                  const fields::SkeletonTensors& own, bool use_own,
                                                  const std::string& name) {
  if (decoder_) return decoder_->decode(latents, use_own ? &own : nullptr, name);
  const torch::NoGradGuard no_grad;
  // The untrained votes are not grouped: they mean nothing, and may be too many joints for the memory.
  const auto decoded = shape_decoder_->forward(latents, {own});
  RigDecoder::Decoded shape;
  shape.asset = decoded_shape(shape_decoder_->extract_meshes(decoded, /*training=*/false).front(), name);
  return shape;
}

void StructuredLatentCoder::write(const models::PerStream<SparseTensor>& latents, const fs::path& file) const {
  write_structured_latents(file, latents, checkpoint());
}

}  // namespace anigen::pipeline
