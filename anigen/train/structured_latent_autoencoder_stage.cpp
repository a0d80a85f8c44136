#include "anigen/train/structured_latent_autoencoder_stage.h"

#include <utility>

#include "anigen/models/freezing.h"
#include "anigen/models/sparse_structure_loss.h"
#include "anigen/models/state_dict.h"
#include "anigen/train/loss_generator.h"
#include "anigen/train/sparse_batch.h"
#include "anigen/train/structured_latent_memory.h"
#include "anigen/train/structured_latent_pictures.h"

namespace anigen::train {
namespace {

using sparse::SparseTensor;
using torch::Tensor;

// What an asset's picture can teach: parameters below these names, in either model, shape the surface or its colours.
constexpr const char* kGeometryParts[] = {"input_layer.", "blocks.", "upsample.", "out_layer."};

bool trains_any_geometry(const torch::nn::Module& model) {
  for (const models::StateEntry& entry : models::state_entries(model)) {
    if (!entry.tensor.requires_grad()) continue;
    for (const char* part : kGeometryParts) {
      if (entry.key.rfind(part, 0) == 0) return true;
    }
  }
  return false;
}

std::vector<Tensor> moved(const std::vector<Tensor>& tensors, torch::Device device) {
  std::vector<Tensor> there;
  for (const Tensor& tensor : tensors) there.push_back(tensor.to(device));
  return there;
}

Tensor drawn_normal(std::int64_t rows, std::int64_t channels, at::Generator& generator, torch::Device device) {
  return torch::randn({rows, channels}, generator, torch::TensorOptions(torch::kFloat32)).to(device);
}

// One share of noise per item, for the rows of its voxels. @return the noised rows
Tensor noised(const Tensor& z, const sparse::Support& support, const LatentDenoising& noise, std::int64_t step,
              at::Generator& generator) {
  const Tensor u = torch::rand({support.items().items()}, generator, torch::TensorOptions(torch::kFloat32));
  const Tensor times = latent_times(u, noise.time_max_at(step), kSparseTimeCut);
  const Tensor item = support.coords().select(1, 0).to(torch::kInt64);
  return mix_latent_noise(z, drawn_normal(z.size(0), z.size(1), generator, z.device()), times.index_select(0, item),
                          noise.gamma);
}

// Weighted terms and the names they are logged under.
class LossSum {
 public:
  void log(const char* name, const Tensor& term) {
    if (term.defined()) losses_.terms.emplace_back(name, term);
  }
  void add(const Tensor& weighted) { losses_.total = losses_.total.defined() ? losses_.total + weighted : weighted; }
  void add(const char* name, const Tensor& term, double weight = 1.0) {
    log(name, term);
    add(weight == 1.0 ? term : weight * term);
  }
  Losses take() { return std::move(losses_); }

 private:
  Losses losses_;
};

Tensor mean_regularizer(const std::vector<fields::ExtractedMesh>& meshes) {
  std::vector<Tensor> terms;
  for (const fields::ExtractedMesh& mesh : meshes) terms.push_back(mesh.regularizer);
  return torch::stack(terms).mean();
}

void log_geometry(LossSum& sum, const models::GeometryLosses& losses) {
  sum.log("tsdf_loss", losses.tsdf);
  sum.log("mask_loss", losses.mask);
  sum.log("depth_loss", losses.depth);
  sum.log("normal_loss", losses.normal);
  sum.log("normal_loss_ssim", losses.normal_ssim);
  sum.log("normal_loss_perceptual", losses.normal_perceptual);
}

}  // namespace

StructuredLatentAutoEncoderStage::StructuredLatentAutoEncoderStage(
    const StructuredLatentCoders& coders, const StructuredLatentAutoEncoderStageOptions& options, Dataset data,
    Dataset held_out, torch::Device device, models::Lpips lpips, nn::Init init)
    : coders_(coders),
      options_(options),
      data_(std::move(data)),
      held_out_(std::move(held_out)),
      device_(device),
      lpips_(std::move(lpips)),
      encoder_(coders.encoder, init),
      decoder_(coders.decoder, init) {
  if (!options_.variant.needs_skin_ae()) silence_skin_encoder();
  encoder_->to(device_);
  decoder_->to(device_);
  trains_geometry_ = trains_any_geometry(*encoder_) || trains_any_geometry(*decoder_);
}

std::unique_ptr<Stage> StructuredLatentAutoEncoderStage::replica() const {
  auto twin = std::make_unique<StructuredLatentAutoEncoderStage>(coders_, options_, data_, held_out_, device_, lpips_,
                                                                 nn::Init::kNone);
  share_frozen_weights(*encoder_, *twin->encoder_);
  share_frozen_weights(*decoder_, *twin->decoder_);
  return twin;
}

// Without a pretrained SkinAE the encoder knows nothing about skin: all of its embeddings are 0 and stay so, and only
// positions reach the skin stream (reference training-and-data.md, 4).
void StructuredLatentAutoEncoderStage::silence_skin_encoder() {
  nn::zero_parameters(*encoder_->skin_encoder());
  models::freeze_modules(*encoder_, {"skin_encoder"});
}

void StructuredLatentAutoEncoderStage::set_compute_dtype(torch::Dtype dtype) {
  encoder_->set_torso_dtype(dtype);
  decoder_->set_torso_dtype(dtype);
}

models::PictureDistance StructuredLatentAutoEncoderStage::picture_distance() {
  if (lpips_.is_empty()) return nullptr;
  return [this](const Tensor& a, const Tensor& b) { return lpips_->forward(a, b); };
}

void StructuredLatentAutoEncoderStage::fit_memory(const loaders::FeatureSkeletonBatch& batch) {
  if (options_.memory_budget_mb == 0) return;
  const std::int64_t bytes =
      activation_bytes(coders_.encoder, coders_.decoder, batch.feats.coords.size(0), batch.feats_skl.coords.size(0));
  const bool recompute = bytes > (options_.memory_budget_mb << 20);
  encoder_->recompute_blocks(recompute || coders_.encoder.use_checkpoint);
  decoder_->recompute_blocks(recompute || coders_.decoder.use_checkpoint);
}

StructuredLatentAutoEncoderStage::Inputs StructuredLatentAutoEncoderStage::inputs_of(
    const loaders::FeatureSkeletonBatch& batch) const {
  Inputs inputs;
  inputs.x = sparse_of(batch.feats, device_);
  inputs.x_skl = sparse_of(batch.feats_skl, device_);
  inputs.rigs.joints = moved(batch.rigs.joints, device_);
  inputs.rigs.parents = moved(batch.rigs.parents, device_);
  inputs.rigs.skin = moved(batch.rigs.skin, device_);
  inputs.rigs.vertices = batch.rigs.vertices;  // only asked for places, on the CPU
  inputs.rigs.faces = batch.rigs.faces;
  inputs.rigs.surfaces = batch.rigs.surfaces;
  for (std::size_t i = 0; i < batch.rigs.joints.size(); ++i) {
    inputs.skeletons.push_back({inputs.rigs.joints[i], inputs.rigs.parents[i].to(torch::kInt64)});
  }
  inputs.is_bad_skin = batch.is_bad_skin;
  return inputs;
}

// Posterior means without a generator. Of the two parts of z only the parts are normalised: see streams_of().
StructuredLatentAutoEncoderStage::Latents StructuredLatentAutoEncoderStage::encode(const Inputs& inputs,
                                                                                   at::Generator* generator) {
  const models::StructuredLatentEncoderOptions& coder = coders_.encoder;
  std::vector<Tensor> noise;
  if (generator != nullptr) {
    const std::int64_t rows = inputs.x.support->size(), rows_skl = inputs.x_skl.support->size();
    noise.push_back(drawn_normal(rows, coder.latent_channels, *generator, device_));
    if (!coder.latent_denoising) {
      noise.push_back(drawn_normal(rows, coder.latent_channels_vertskin, *generator, device_));
      noise.push_back(drawn_normal(rows_skl, coder.latent_channels_skl, *generator, device_));
    }
  }
  Latents latents = encoder_->forward(inputs.x, inputs.x_skl, inputs.rigs, noise);
  latents.z_skin = models::renormalized(latents.z_skin, coder, options_.variant.latent_norm);
  latents.z_skl.feats = models::renormalized(latents.z_skl.feats, coder, options_.variant.latent_norm);
  return latents;
}

// Apart, so that a frozen geometry keeps nothing for the backward pass.
models::PerStream<SparseTensor> StructuredLatentAutoEncoderStage::streams_of(const Latents& latents) {
  return {latents.z.with(latents.z_geometry), latents.z.with(latents.z_skin), latents.z_skl};
}

models::RigLosses StructuredLatentAutoEncoderStage::compare_rigs(const Inputs& inputs, const Latents& latents,
                                                                 const Fields& decoded, const Meshes& meshes,
                                                                 const std::vector<Tensor>& chosen) {
  const models::RigLossOptions& rig = options_.rig;
  const bool pretrained = options_.variant.needs_skin_ae();
  std::vector<models::RigPrediction> predictions;
  std::vector<models::RigTruth> truths;
  for (std::size_t i = 0; i < meshes.size(); ++i) {
    models::RigPrediction predicted;
    predicted.field = decoded.skeletons[i];
    predicted.joints = inputs.skeletons[i].joints;
    if (rig.lambda_skin_var > 0.0) predicted.variance = decoded.joint_features[i].variance;
    predicted.mesh = meshes[i].success;
    models::RigTruth truth;
    truth.joints = inputs.skeletons[i].joints;
    truth.parents = inputs.skeletons[i].parents;
    truth.skin = inputs.rigs.skin[i];
    truth.is_bad_skin = inputs.is_bad_skin[i];
    if (pretrained && rig.lambda_skin_feats_l2_skl > 0.0) truth.joint_features = latents.joint_skin_embeds[i];
    if (pretrained && rig.lambda_skin_feats_l2 > 0.0) truth.vertex_features = latents.vert_skin_embeds[i];
    if (predicted.mesh && !truth.is_bad_skin) {
      const auto part = [&](const Tensor& rows) {
        return chosen[i].defined() ? rows.index_select(0, chosen[i]) : rows;
      };
      const Tensor vertices = part(meshes[i].vertices.detach());
      truth.mix = inputs.rigs.surfaces.empty()
                      ? models::nearest_vertex_mix(inputs.rigs.vertices[i], vertices)
                      : models::nearest_surface_mix(*inputs.rigs.surfaces[i], inputs.rigs.vertices[i],
                                                    inputs.rigs.faces[i], vertices, models::kLossLeastWeight);
      predicted.vertex_features = part(meshes[i].skin_features);
      if (rig.lambda_skin_kl > 0.0) {
        predicted.skin =
            decoder_->skin_weights(predicted.vertex_features, inputs.skeletons[i], decoded.joint_features[i].features);
      }
    }
    predictions.push_back(std::move(predicted));
    truths.push_back(std::move(truth));
  }
  return models::rig_losses(predictions, truths, rig);
}

Losses StructuredLatentAutoEncoderStage::losses(const loaders::Batch& batch, const LossContext& context) {
  const auto& assets = dynamic_cast<const loaders::FeatureSkeletonBatch&>(batch);
  fit_memory(assets);
  at::Generator generator = loss_generator(context, "structured latents");
  const Inputs inputs = inputs_of(assets);
  const Latents latents = encode(inputs, &generator);
  LossSum sum;

  models::PerStream<SparseTensor> z = streams_of(latents);
  if (options_.noise.enabled) {
    z.skin.feats = noised(z.skin.feats, *z.skin.support, options_.noise, context.step, generator);
  } else {
    sum.add("kl", models::posterior_kl(latents.mean, latents.logvar), options_.lambda_kl);
  }
  if (options_.noise_skl.enabled) {
    z.skeleton.feats = noised(z.skeleton.feats, *z.skeleton.support, options_.noise_skl, context.step, generator);
  } else {
    sum.add("kl_skl", models::posterior_kl(latents.mean_skl, latents.logvar_skl), options_.lambda_kl_skl);
  }

  const Fields decoded = decoder_->forward(z, inputs.skeletons);
  const Meshes meshes = decoder_->extract_meshes(decoded, /*training=*/true);
  sum.add("reg_loss", mean_regularizer(meshes));

  std::vector<std::size_t> with_surface, lost;
  for (std::size_t i = 0; i < meshes.size(); ++i) (meshes[i].success ? with_surface : lost).push_back(i);
  if (trains_geometry_ && !lost.empty() && options_.lambda_lost_surface > 0.0) {
    const std::int64_t resolution = options_.geometry.resolution;
    const Tensor tsdf = mean_tsdf_loss(meshes, lost, true_pictures(lost, assets, device_), assets, resolution);
    const double truncation = models::tsdf_truncation(resolution);
    sum.add("lost_surface_loss", tsdf / (truncation * truncation), options_.lambda_lost_surface);
  }
  if (trains_geometry_ && !with_surface.empty()) {
    const models::SurfacePictures truth = true_pictures(with_surface, assets, device_);
    const DecodedPictures pictures = decoded_pictures(meshes, with_surface, assets, device_);
    const Tensor tsdf = mean_tsdf_loss(meshes, with_surface, truth, assets, options_.geometry.resolution);
    const models::GeometryLosses geometry =
        models::geometry_losses(pictures.surface, truth, tsdf, options_.geometry, picture_distance());
    sum.add("geo_loss", geometry.total);
    log_geometry(sum, geometry);
    if (options_.geometry.lambda_color > 0.0 && pictures.color.defined()) {
      const std::vector<std::int64_t> rows(with_surface.begin(), with_surface.end());
      const Tensor chosen = torch::tensor(rows, torch::kInt64);
      sum.add("color_loss", models::color_loss(pictures.color, assets.image.index_select(0, chosen).to(device_),
                                               assets.alpha.index_select(0, chosen).to(device_), options_.geometry,
                                               picture_distance()));
    }
  }

  if (!options_.variant.geometry_only) {
    std::vector<Tensor> chosen(meshes.size());
    for (const std::size_t i : with_surface) {
      const std::int64_t count = meshes[i].vertices.size(0);
      if (options_.skin_vertices == 0 || count <= options_.skin_vertices) continue;
      chosen[i] = torch::randperm(count, generator, torch::TensorOptions(torch::kInt64))
                      .slice(0, 0, options_.skin_vertices)
                      .to(device_);
    }
    const models::RigLosses rig = compare_rigs(inputs, latents, decoded, meshes, chosen);
    sum.add(rig.total(options_.rig));
    sum.log("joints_loss", rig.joints);
    sum.log("parents_loss", rig.parents);
    sum.log("skin_feats_joints_var_loss", rig.skin_var);
    sum.log("skin_kl_loss", rig.skin_kl);
    sum.log("skin_feats_l2_loss_vert", rig.skin_feats_l2_vert);
    sum.log("skin_feats_l2_loss_joints", rig.skin_feats_l2_joints);
  }
  return sum.take();
}

}  // namespace anigen::train
