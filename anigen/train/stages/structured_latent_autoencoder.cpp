#include "anigen/train/stages/structured_latent_autoencoder.h"

#include <algorithm>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/data/voxel_files.h"
#include "anigen/nn/state_dict.h"
#include "anigen/sparse_structure/voxel_metrics.h"
#include "anigen/train/stages/flow_stage.h"
#include "anigen/train/stages/structured_latent_report.h"

namespace anigen::train {

namespace {

using sparse::SparseTensor;
using torch::Tensor;

// Parameters below these names, in either model, shape the surface or its colours: images can train them.
constexpr const char* kGeometryParts[] = {"input_layer.", "blocks.", "upsample.", "out_layer."};

bool trains_any_geometry(const torch::nn::Module& model) {
  for (const nn::StateEntry& entry : nn::state_entries(model)) {
    if (!entry.tensor.requires_grad()) continue;
    for (const char* part : kGeometryParts) {
      if (entry.key.rfind(part, 0) == 0) return true;
    }
  }
  return false;
}

// z_t = (1 − t) z + t γ ε with one share of noise t per item, for the rows of its voxels.
Tensor noised(const Tensor& z, const sparse::Support& support, const LatentDenoising& noise, std::int64_t step,
              at::Generator& generator) {
  const Tensor u = torch::rand({support.items().items()}, generator, torch::TensorOptions(torch::kFloat32));
  const Tensor t = latent_times(u, noise.time_max_at(step), kSparseTimeCut);
  const Tensor item = support.coords().select(1, 0).to(torch::kInt64);
  return mix_latent_noise(z, normal_draws(z.sizes(), generator, z.device()), t.index_select(0, item), noise.gamma);
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

Tensor mean_regularizer(const std::vector<shape_field::ExtractedMesh>& meshes) {
  std::vector<Tensor> terms;
  for (const shape_field::ExtractedMesh& mesh : meshes) terms.push_back(mesh.regularizer);
  return torch::stack(terms).mean();
}

// Modules of the SkinAE in the two models.
constexpr const char* kSkinEncoderModule = "skin_encoder";
constexpr const char* kSkinDecoderModule = "skin_decoder";

// "warm_start": "none" trains what published runs take from TRELLIS; the SkinAE, which stage 1 trained, stays frozen.
void unfreeze_all_but_skin(structured_latent::StructuredLatentCoderOptions& coder, const char* skin_module,
                           bool skin_ae) {
  coder.modules_to_freeze.clear();
  coder.use_pretrain_branch = coder.freeze_pretrain_branch = skin_ae;
  if (skin_ae) coder.modules_to_freeze.emplace_back(skin_module);
}

// The first asset says whether models and dataset fit, before a run folder is touched.
void require_fitting_features(const data::BatchSource& data, const StructuredLatentCoders& coders,
                              const std::string& file) {
  const std::unique_ptr<data::Batch> batch = data.load({data::Draw{0, 0}});
  const auto& assets = dynamic_cast<const data::FeatureSkeletonBatch&>(*batch);
  const std::int64_t channels = assets.feats.feats.size(1);
  if (channels == coders.encoder.in_channels) return;
  throw InputError(file, "/models/encoder/args/in_channels",
                   std::to_string(coders.encoder.in_channels) + ", but the dataset's features have " +
                       std::to_string(channels) + " channels");
}

void say_what_is_left_out(const StructuredLatentAutoEncoderStage& stage,
                          const StructuredLatentAutoEncoderStageOptions& options) {
  if (!stage.trains_geometry())
    log::info("the geometry branch is frozen: nothing is rendered, and geo_loss and color_loss are left out");
  if (options.variant.joint_skin)
    log::info("skin_ae joint: the encoder sees no skin, and there are no features of a SkinAE to compare with");
  if (options.variant.geometry_only) log::info("geometry_only: losses of skeleton and skin are left out");
}

constexpr const char* kSkinAutoEncoderClass = "SkinAutoEncoder";

struct SkinWeightsFile {
  io::NamedArrays arrays;
  std::string source;
};

// The part of a trained SkinAE that belongs into a model; published and own checkpoints name it alike.
SkinWeightsFile skin_weights_of_run(const std::filesystem::path& run, const std::string& part) {
  const nn::RunModel found = nn::find_run_model(run, kSkinAutoEncoderClass);
  SkinWeightsFile file{{}, found.checkpoint.string()};
  for (auto& [key, array] : io::read_state_dict(found.checkpoint)) {
    if (key.rfind(part + ".", 0) == 0) file.arrays.emplace_back(key, std::move(array));
  }
  if (file.arrays.empty()) throw InputError(file.source, "", "holds no " + part);
  return file;
}

}  // namespace

StructuredLatentAutoEncoderStage::StructuredLatentAutoEncoderStage(
    const StructuredLatentCoders& coders, const StructuredLatentAutoEncoderStageOptions& options, Dataset data,
    Dataset held_out, torch::Device device, vision::Lpips lpips, nn::Init init)
    : AutoEncoderStage(coders, options, std::move(data), std::move(held_out), device, init), lpips_(std::move(lpips)) {
  if (!options_.variant.needs_skin_ae()) silence_skin_encoder();
  if (options_.frozen_encoder) {
    for (Tensor& parameter : encoder_->parameters()) parameter.set_requires_grad(false);
  }
  trains_geometry_ = trains_any_geometry(*encoder_) || trains_any_geometry(*decoder_);
}

// Without a pretrained SkinAE the encoder knows nothing about skin: all of its embeddings are 0 and stay so, and only
// positions reach the skin stream (docs/reference/training.md, 4).
void StructuredLatentAutoEncoderStage::silence_skin_encoder() {
  nn::zero_parameters(*encoder_->skin_encoder());
  nn::freeze_modules(*encoder_, {"skin_encoder"});
}

shape_field::PictureDistance StructuredLatentAutoEncoderStage::picture_distance() {
  if (lpips_.is_empty()) return nullptr;
  return [this](const Tensor& a, const Tensor& b) { return lpips_->forward(a, b); };
}

void StructuredLatentAutoEncoderStage::fit_memory(const data::FeatureSkeletonBatch& batch) {
  if (options_.memory_budget_mb == 0) return;
  const std::int64_t bytes =
      activation_bytes(coders_.encoder, coders_.decoder, batch.feats.coords.size(0), batch.feats_skl.coords.size(0));
  const bool recompute = bytes > (options_.memory_budget_mb << 20);
  encoder_->recompute_blocks(recompute || coders_.encoder.use_checkpoint);
  decoder_->recompute_blocks(recompute || coders_.decoder.use_checkpoint);
}

StructuredLatentAutoEncoderStage::Inputs StructuredLatentAutoEncoderStage::inputs_of(
    const data::FeatureSkeletonBatch& batch) const {
  Inputs inputs;
  inputs.x = sparse_of(batch.feats, device_);
  inputs.x_skl = sparse_of(batch.feats_skl, device_);
  inputs.rigs.joints = on_device(batch.rigs.joints, device_);
  inputs.rigs.parents = on_device(batch.rigs.parents, device_);
  inputs.rigs.skin = on_device(batch.rigs.skin, device_);
  inputs.rigs.vertices = batch.rigs.vertices;  // only asked for places, on the CPU
  inputs.rigs.faces = batch.rigs.faces;
  inputs.rigs.surfaces = batch.rigs.surfaces;
  for (std::size_t i = 0; i < batch.rigs.joints.size(); ++i) {
    inputs.skeletons.push_back({inputs.rigs.joints[i], inputs.rigs.parents[i].to(torch::kInt64)});
  }
  inputs.is_bad_skin = batch.is_bad_skin;
  return inputs;
}

// Posterior means without a generator, and of a geometry that is no posterior. Of the two parts of z only the parts are
// normalised: see streams_of().
StructuredLatentAutoEncoderStage::Latents StructuredLatentAutoEncoderStage::encode(const Inputs& inputs,
                                                                                   at::Generator* generator) {
  const structured_latent::StructuredLatentEncoderOptions& coder = coders_.encoder;
  std::vector<Tensor> noise;
  if (generator != nullptr) {
    const std::int64_t rows = inputs.x.support->size(), rows_skl = inputs.x_skl.support->size();
    noise.push_back(options_.variant.geometry_dae ? torch::zeros({rows, coder.latent_channels}, device_)
                                                  : normal_draws({rows, coder.latent_channels}, *generator, device_));
    if (!coder.latent_denoising) {
      noise.push_back(normal_draws({rows, coder.latent_channels_vertskin}, *generator, device_));
      noise.push_back(normal_draws({rows_skl, coder.latent_channels_skl}, *generator, device_));
    }
  }
  Latents latents = encoder_->forward(inputs.x, inputs.x_skl, inputs.rigs, noise);
  latents.z_geometry = structured_latent::geometry_latent(latents.z_geometry, coder, options_.variant);
  latents.z_skin = structured_latent::renormalized(latents.z_skin, coder, options_.variant.latent_norm);
  latents.z_skl.feats = structured_latent::renormalized(latents.z_skl.feats, coder, options_.variant.latent_norm);
  return latents;
}

// Apart, so that a frozen geometry keeps nothing for the backward pass.
structured_latent::PerStream<SparseTensor> StructuredLatentAutoEncoderStage::streams_of(const Latents& latents) {
  return {latents.z.with(latents.z_geometry), latents.z.with(latents.z_skin), latents.z_skl};
}

structured_latent::RigLosses StructuredLatentAutoEncoderStage::compare_rigs(const Inputs& inputs,
                                                                            const Latents& latents,
                                                                            const Fields& decoded, const Meshes& meshes,
                                                                            const std::vector<Tensor>& chosen) {
  const structured_latent::RigLossOptions& rig = options_.rig;
  const bool pretrained = options_.variant.needs_skin_ae();
  std::vector<structured_latent::RigPrediction> predictions;
  std::vector<structured_latent::RigTruth> truths;
  for (std::size_t i = 0; i < meshes.size(); ++i) {
    structured_latent::RigPrediction predicted;
    predicted.field = decoded.skeletons[i];
    predicted.joints = inputs.skeletons[i].joints;
    if (rig.lambda_skin_var > 0.0) predicted.variance = decoded.joint_features[i].variance;
    predicted.mesh = meshes[i].success;
    structured_latent::RigTruth truth;
    truth.joints = inputs.skeletons[i].joints;
    truth.parents = inputs.skeletons[i].parents;
    truth.skin = inputs.rigs.skin[i];
    truth.is_bad_skin = inputs.is_bad_skin[i];
    if (pretrained && rig.lambda_skin_feats_l2_skl > 0.0) truth.joint_features = latents.joint_skin_embeds[i];
    if (pretrained && rig.lambda_skin_feats_l2 > 0.0) truth.vertex_features = latents.vert_skin_embeds[i];
    if (predicted.mesh && !truth.is_bad_skin) {
      const Tensor all = meshes[i].vertices.detach();
      const Tensor vertices = chosen[i].defined() ? all.index_select(0, chosen[i]) : all;
      truth.mix = inputs.rigs.surfaces.empty()
                      ? skin_field::nearest_vertex_mix(inputs.rigs.vertices[i], vertices)
                      : skin_field::nearest_surface_mix(*inputs.rigs.surfaces[i], inputs.rigs.vertices[i],
                                                        inputs.rigs.faces[i], vertices, skin_field::kLossLeastWeight);
      predicted.vertex_features = shape_field::skin_features_at(meshes[i], decoder_->mesh_options(), chosen[i]);
      if (rig.lambda_skin_kl > 0.0) {
        predicted.skin =
            decoder_->skin_weights(predicted.vertex_features, inputs.skeletons[i], decoded.joint_features[i].features);
      }
    }
    predictions.push_back(std::move(predicted));
    truths.push_back(std::move(truth));
  }
  return structured_latent::rig_losses(predictions, truths, rig);
}

Losses StructuredLatentAutoEncoderStage::losses(const data::Batch& batch, const LossContext& context) {
  const auto& assets = dynamic_cast<const data::FeatureSkeletonBatch&>(batch);
  fit_memory(assets);
  at::Generator generator = loss_generator(context, "structured latents");
  const Inputs inputs = inputs_of(assets);
  Latents latents;
  {
    const torch::AutoGradMode with_grad(!options_.frozen_encoder);
    latents = encode(inputs, &generator);
  }
  LossSum sum;

  // λ_kl KL(N(μ, σ²) ‖ N(0, 1)) of the latents that get no noise; the others become z_t.
  structured_latent::PerStream<SparseTensor> z = streams_of(latents);
  if (options_.noise.enabled) {
    z.skin.feats = noised(z.skin.feats, *z.skin.support, options_.noise, context.step, generator);
    if (options_.variant.geometry_dae)
      z.geometry.feats = noised(z.geometry.feats, *z.geometry.support, options_.noise, context.step, generator);
  } else if (!options_.frozen_encoder) {
    const std::int64_t first = options_.variant.geometry_dae ? coders_.encoder.latent_channels : 0;
    sum.add("kl", sparse_structure::posterior_kl(latents.mean.slice(1, first), latents.logvar.slice(1, first)),
            options_.lambda_kl);
  }
  if (options_.noise_skl.enabled) {
    z.skeleton.feats = noised(z.skeleton.feats, *z.skeleton.support, options_.noise_skl, context.step, generator);
  } else if (!options_.frozen_encoder) {
    sum.add("kl_skl", sparse_structure::posterior_kl(latents.mean_skl, latents.logvar_skl), options_.lambda_kl_skl);
  }

  // The S³ fields over the true joints, their surfaces, and L_reg of FlexiCubes.
  const Fields decoded = decoder_->forward(z, inputs.skeletons);
  const Meshes meshes = decoder_->extract_meshes(decoded, /*training=*/true, shape_field::SkinFeatures::kWhenAskedFor);
  sum.add("reg_loss", mean_regularizer(meshes));

  // L_geo and L_color of the assets with a surface, which pictures can compare; λ · tsdf_loss / τ² of the others.
  std::vector<std::size_t> with_surface, lost;
  for (std::size_t i = 0; i < meshes.size(); ++i) (meshes[i].success ? with_surface : lost).push_back(i);
  if (trains_geometry_ && !lost.empty() && options_.lambda_lost_surface > 0.0) {
    const std::int64_t resolution = options_.geometry.resolution;
    const Tensor tsdf = mean_tsdf_loss(meshes, lost, true_pictures(lost, assets, device_), assets, resolution);
    const double truncation = shape_field::tsdf_truncation(resolution);
    sum.add("lost_surface_loss", tsdf / (truncation * truncation), options_.lambda_lost_surface);
  }
  if (trains_geometry_ && !with_surface.empty()) {
    const shape_field::SurfacePictures truth = true_pictures(with_surface, assets, device_);
    const DecodedPictures pictures = decoded_pictures(meshes, with_surface, assets, device_);
    const Tensor tsdf = mean_tsdf_loss(meshes, with_surface, truth, assets, options_.geometry.resolution);
    const shape_field::GeometryLosses geometry =
        shape_field::geometry_losses(pictures.surface, truth, tsdf, options_.geometry, picture_distance());
    sum.add("geo_loss", geometry.total);
    sum.log("tsdf_loss", geometry.tsdf);
    sum.log("mask_loss", geometry.mask);
    sum.log("depth_loss", geometry.depth);
    sum.log("normal_loss", geometry.normal);
    sum.log("normal_loss_ssim", geometry.normal_ssim);
    sum.log("normal_loss_perceptual", geometry.normal_perceptual);
    if (options_.geometry.lambda_color > 0.0 && pictures.color.defined()) {
      const std::vector<std::int64_t> rows(with_surface.begin(), with_surface.end());
      const Tensor chosen = torch::tensor(rows, torch::kInt64);
      sum.add("color_loss", shape_field::color_loss(pictures.color, assets.image.index_select(0, chosen).to(device_),
                                                    assets.alpha.index_select(0, chosen).to(device_), options_.geometry,
                                                    picture_distance()));
    }
  }

  // L_rig: joints, parents and skin weights at vertices, all of them or some drawn anew.
  if (!options_.variant.geometry_only) {
    std::vector<Tensor> chosen(meshes.size());
    for (const std::size_t i : with_surface) {
      const std::int64_t count = meshes[i].vertices.size(0);
      if (options_.skin_vertices == 0 || count <= options_.skin_vertices) continue;
      chosen[i] = torch::randperm(count, generator, torch::TensorOptions(torch::kInt64))
                      .slice(0, 0, options_.skin_vertices)
                      .to(device_);
    }
    const structured_latent::RigLosses rig = compare_rigs(inputs, latents, decoded, meshes, chosen);
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

void StructuredLatentCoders::validate(const std::string& file) const {
  const std::string pointer = "/models/decoder/args";
  const auto require_equal = [&](std::int64_t found, std::int64_t wanted, const char* key) {
    OptionCheck{file, pointer}(found == wanted, key,
                               std::to_string(found) + " differs from the encoder's " + std::to_string(wanted));
  };
  require_equal(decoder.resolution, encoder.resolution, "resolution");
  require_equal(decoder.latent_channels, encoder.latent_channels, "latent_channels");
  require_equal(decoder.latent_channels_skl, encoder.latent_channels_skl, "latent_channels_skl");
  require_equal(decoder.latent_channels_vertskin, encoder.latent_channels_vertskin, "latent_channels_vertskin");
  require_equal(decoder.skin_decoder_config.skin_feat_channels, encoder.skin_encoder_config.skin_feat_channels,
                "skin_decoder_config/skin_feat_channels");
}

std::unique_ptr<Stage> make_structured_latent_autoencoder_stage(const StageRequest& request) {
  ConfigReader top(request.config, request.file);
  auto coders = read_coders<StructuredLatentCoders>(top, structured_latent::kStructuredLatentEncoderClass,
                                                    structured_latent::kStructuredLatentDecoderClass);
  const auto options =
      StructuredLatentAutoEncoderStageOptions::read(request.args, coders.decoder, request.trainer.compatibility);
  options.variant.apply(coders.encoder, request.file);
  const bool skin_ae = options.variant.needs_skin_ae();
  std::vector<std::string>& frozen = coders.decoder.modules_to_freeze;
  if (!skin_ae) frozen.erase(std::remove(frozen.begin(), frozen.end(), kSkinDecoderModule), frozen.end());
  if (!options.warm_start.enabled) {
    unfreeze_all_but_skin(coders.encoder, kSkinEncoderModule, skin_ae);
    unfreeze_all_but_skin(coders.decoder, kSkinDecoderModule, skin_ae);
  }
  if (options.geometry.lambda_color > 0.0 && !coders.decoder.use_color)
    throw request.args.error("lambda_color", "needs a decoder with representation_config.use_color");

  const data::Datasets data = autoencoder_datasets(top, "AniGenSparseFeat2Skeleton", request.trainer.seed);
  const std::int64_t grid = top.object("dataset").object("args").integer("resolution", data::kStoredResolution, 1);
  if (coders.encoder.resolution != grid) {
    throw InputError(request.file, "/models/encoder/args/resolution",
                     "must be " + std::to_string(grid) + ", the grid of the dataset's voxels");
  }
  require_fitting_features(*data.train, coders, request.file);

  vision::Lpips lpips = nullptr;
  if (!options.lpips_weights.empty()) {
    lpips = vision::load_lpips(options.lpips_weights);
    lpips->to(request.device);
  }
  auto stage =
      std::make_unique<StructuredLatentAutoEncoderStage>(coders, options, data.train, data.eval, request.device, lpips);
  if (stage->trains_geometry() && options.geometry.perceptual.lambda_lpips > 0.0 && lpips.is_empty()) {
    throw request.args.error("lambda_lpips",
                             "LPIPS needs its weights: name the files of VGG16 and of its heads in "
                             "trainer.args.lpips_weights, or set lambda_lpips to 0");
  }
  say_what_is_left_out(*stage, options);
  return stage;
}

void StructuredLatentAutoEncoderStage::start_model(torch::nn::Module& model, bool pretrained, const char* class_name,
                                                   const std::string& skin_name, const std::string& skin_part,
                                                   std::set<std::string> loaded) {
  const bool wants_skin = options_.variant.needs_skin_ae();
  std::vector<PretrainedFile> files;
  if (pretrained && options_.warm_start.enabled) files.push_back({class_name, ""});
  SkinWeightsFile skin;
  if (wants_skin && options_.skin_ae_run.empty()) files.push_back({skin_name, skin_part});
  if (wants_skin && !options_.skin_ae_run.empty()) {
    skin = skin_weights_of_run(options_.skin_ae_run, skin_part);
    for (const auto& entry : skin.arrays) loaded.insert(entry.first);
  }
  if (!wants_skin) {
    // The silent encoder is as it shall be.
    for (const std::string& key : nn::frozen_parameters(model)) {
      if (key.rfind("skin_encoder.", 0) == 0) loaded.insert(key);
    }
  }
  // With "warm_start": "none" the SkinAE still is a trained one; only the shape begins anew.
  WarmStartOptions reading = options_.warm_start;
  reading.enabled = true;
  if (!files.empty() || pretrained) load_pretrained(model, files, reading, std::move(loaded));
  if (!skin.arrays.empty()) load_matching(model, skin.arrays, skin.source);
}

void StructuredLatentAutoEncoderStage::warm_start(const LoadedKeys& finetuned) {
  if (options_.frozen_encoder && finetuned.count("encoder") == 0)
    throw InputError("", "trainer/args/frozen_encoder",
                     "needs a trained encoder: --load a run or its exported weights, or name them in finetune_ckpt");
  const auto& encoder = coders_.encoder;
  const auto& decoder = coders_.decoder;
  start_model(*encoder_, encoder.use_pretrain_branch, structured_latent::kStructuredLatentEncoderClass,
              encoder.skin_ae_name, "skin_encoder", keys_of(finetuned, "encoder"));
  start_model(*decoder_, decoder.use_pretrain_branch, structured_latent::kStructuredLatentDecoderClass,
              decoder.skin_ae_name, "skin_decoder", keys_of(finetuned, "decoder"));
  if (!options_.variant.needs_skin_ae()) silence_skin_encoder();  // whatever a file of weights holds of it
}

}  // namespace anigen::train
