#include <algorithm>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/short_id.h"
#include "anigen/loaders/files/rig_arrays.h"
#include "anigen/loaders/latent_normalization.h"
#include "anigen/models/voxel_picture.h"
#include "anigen/raytrace/contact_sheet.h"
#include "anigen/train/loss_generator.h"
#include "anigen/train/rig_pictures.h"
#include "anigen/train/structured_latent_flow_stage.h"
#include "anigen/train/tensor_mesh.h"

// What a run shows of itself; the loss is in structured_latent_flow_stage.cpp.
namespace anigen::train {
namespace {

using torch::Tensor;

// A row of the sheet behind the picture: a sample twice, the asset's latents twice, the asset.
constexpr int kTilesPerAsset = 5;

struct DecodedPair {
  io::Image skeleton = empty_rig_picture(), weights = empty_rig_picture();
  std::string problem;  // why both are empty
};

// Latents as the decoder was trained with them.
DecodedPair decoded_pair(models::StructuredLatentDecoder& decoder,
                         const models::PerStream<sparse::SparseTensor>& latents) {
  DecodedPair pair;
  const auto decoded = decoder->forward(latents);
  const fields::ExtractedMesh mesh = decoder->extract_meshes(decoded, /*training=*/false).front();
  if (!mesh.success) {
    pair.problem = "no surface";
    return pair;
  }
  const fields::SkeletonTensors& skeleton = decoded.joints.front();
  Asset asset;
  asset.mesh = mesh_of(mesh.vertices, mesh.faces);
  set_vertex_colors(asset.mesh, mesh.attributes);
  pair.skeleton = picture_with_skeleton(asset, skeleton);
  pair.weights = picture_with_weights(
      asset, decoder->skin_weights(mesh.skin_features, skeleton, decoded.joint_features.front().features));
  return pair;
}

// An early sample may be no latent at all; the training goes on.
DecodedPair decoded_or_problem(models::StructuredLatentDecoder& decoder,
                               const models::PerStream<sparse::SparseTensor>& latents, const std::string& name) {
  try {
    return decoded_pair(decoder, latents);
  } catch (const InputError& error) {
    log::warn("{}: {}", name, error.what());
    DecodedPair nothing;
    nothing.problem = "cannot be decoded";
    return nothing;
  }
}

void add_tiles(std::vector<raytrace::Tile>& tiles, const DecodedPair& pair, const std::string& what) {
  tiles.push_back({pair.skeleton, what + (pair.problem.empty() ? "" : ": " + pair.problem)});
  tiles.push_back({pair.weights, pair.problem.empty() ? what + ", weights" : ""});
}

raytrace::Tile tile_of_asset(const loaders::AssetId& id) {
  loaders::RigBatch rig;
  try {
    rig.append(loaders::read_rig_arrays(id));
  } catch (const InputError& error) {  // a flow trains without rigs
    return {empty_rig_picture(), "no rig"};
  }
  Asset asset;
  asset.mesh = mesh_of(rig.vertices.front(), rig.faces.front());
  return {picture_with_skeleton(asset, {rig.joints.front(), rig.parents.front().to(torch::kInt64)}), "the asset"};
}

}  // namespace

flow::Streams StructuredLatentFlowStage::drawn_sample(const Latents& latents, const Tensor& condition,
                                                      std::uint64_t number) {
  const at::Generator generator = nn::numbered_generator(options_.seed, "structured-latent sample", number);
  flow::Streams noise = models::structured_latent_noise(parts_.model->options(), *latents.shape.support,
                                                        *latents.skeleton.support, options_.smoothing, generator);
  for (Tensor& stream : noise) stream = placed(stream);
  const models::StructuredLatentTarget target{latents.shape.support, latents.skeleton.support, condition,
                                              latents.joints_num};
  const bool guided = parts_.encoder || latents.joints_num.defined();
  return flow::sample_flow(noise, models::structured_latent_velocities(parts_.model, target, guided), options_.sampler)
      .samples;
}

void StructuredLatentFlowStage::sample(const std::filesystem::path& folder) {
  if (!parts_.decoder) return;
  const torch::NoGradGuard no_grad;
  const loaders::StructuredLatentDataset& assets = shown_assets();
  const loaders::StructuredLatentOptions& reading = assets.options();
  std::vector<raytrace::Tile> tiles;
  const std::size_t count = std::min(static_cast<std::size_t>(options_.sample_assets), assets.assets());
  for (std::size_t i = 0; i < count; ++i) {
    const auto batch = assets.load({loaders::Draw{assets.item_of(i), i}});  // each asset once, however often it repeats
    const auto& given = dynamic_cast<const loaders::StructuredLatentBatch&>(*batch);
    const std::string name = short_id(given.ids.front());
    const Latents latents = latents_of(given);
    const auto decoded = [&](const Tensor& x, const Tensor& x_skl) {
      const Tensor rows = loaders::denormalised(x.to(torch::kFloat32), reading.normalization);
      return decoded_or_problem(
          parts_.decoder,
          {latents.shape.with(geometry_channels(rows)), latents.shape.with(skin_channels(rows)),
           latents.skeleton.with(loaders::denormalised(x_skl.to(torch::kFloat32), reading.normalization_skl))},
          name);
    };
    const flow::Streams drawn = drawn_sample(latents, condition_of(given.cond, 1), i);
    if (parts_.encoder)
      tiles.push_back({models::fitted_picture(models::picture_of_planes(given.cond[0]), kRigPictureSize), name});
    add_tiles(tiles, decoded(drawn[0], drawn[1]), parts_.encoder ? "sample" : name + ": sample");
    add_tiles(tiles, decoded(latents.shape.feats, latents.skeleton.feats), "its latents");
    tiles.push_back(tile_of_asset(assets.asset(i)));
  }
  raytrace::SheetOptions sheet;
  sheet.columns = kTilesPerAsset + (parts_.encoder ? 1 : 0);
  sheet.text_height = 11;
  io::write_png(folder / "samples.png", raytrace::contact_sheet(tiles, sheet));
}

}  // namespace anigen::train
