// Trainer arguments of the structured-latent auto-encoder.
#include "anigen/train/structured_latent_autoencoder_stage.h"

namespace anigen::train {
namespace {

void read_geometry_terms(ConfigReader& args, models::GeometryLossOptions& geometry) {
  geometry.set_depth_loss(args.choice("depth_loss_type", "l1", {"l1", "smooth_l1"}));
  geometry.lambda_depth = args.number("lambda_depth", geometry.lambda_depth, 0.0);
  geometry.lambda_tsdf = args.number("lambda_tsdf", geometry.lambda_tsdf, 0.0);
  geometry.lambda_color = args.number("lambda_color", geometry.lambda_color, 0.0);
  geometry.perceptual.lambda_ssim = args.number("lambda_ssim", geometry.perceptual.lambda_ssim, 0.0);
  geometry.perceptual.lambda_lpips = args.number("lambda_lpips", geometry.perceptual.lambda_lpips, 0.0);
}

void read_rig_terms(ConfigReader& args, models::RigLossOptions& rig) {
  rig.lambda_joints = args.number("lambda_joints", rig.lambda_joints, 0.0);
  rig.lambda_parents = args.number("lambda_parents", rig.lambda_parents, 0.0);
  rig.lambda_skin_kl = args.number("lambda_skin_kl", rig.lambda_skin_kl, 0.0);
  rig.lambda_skin_var = args.number("lambda_skin_var", rig.lambda_skin_var, 0.0);
  rig.lambda_skin_feats_l2 = args.number("lambda_skin_feats_l2", rig.lambda_skin_feats_l2, 0.0);
  rig.lambda_skin_feats_l2_skl = args.number("lambda_skin_feats_l2_skl", rig.lambda_skin_feats_l2_skl, 0.0);
  rig.skeleton.alpha_conf_j = args.number("alpha_conf_j", rig.skeleton.alpha_conf_j, 0.0);
  rig.skeleton.alpha_conf_p = args.number("alpha_conf_p", rig.skeleton.alpha_conf_p, 0.0);
}

}  // namespace

StructuredLatentAutoEncoderStageOptions StructuredLatentAutoEncoderStageOptions::read(
    ConfigReader& args, const models::StructuredLatentDecoderOptions& decoder, const std::string& compatibility) {
  const bool paper = compatibility == "paper";
  StructuredLatentAutoEncoderStageOptions options;
  options.variant = models::StructuredLatentVariant::read(args, decoder, compatibility);
  options.rig.skeleton = models::SkeletonLossOptions::compatible(compatibility);
  options.rig.skeleton.confidence = options.variant.confidence;
  options.rig.true_feature_confidence = paper;
  options.geometry.extra_color_l1 = !paper;
  options.geometry.resolution = decoder.mesh_options().resolution;
  read_geometry_terms(args, options.geometry);
  options.lambda_lost_surface = args.number("lambda_lost_surface", options.lambda_lost_surface, 0.0);
  read_rig_terms(args, options.rig);
  options.lambda_kl = args.number("lambda_kl", options.lambda_kl, 0.0);
  options.lambda_kl_skl = args.number("lambda_kl_skl", options.lambda_kl_skl, 0.0);
  const bool says_noise = args.has("latent_denoising"), says_noise_skl = args.has("latent_denoising_skl");
  options.noise = LatentDenoising::read(args, "");
  options.noise_skl = LatentDenoising::read(args, "_skl");
  // The paper's latents are all those of a denoising auto-encoder.
  if (paper && !says_noise) options.noise.enabled = true;
  if (paper && !says_noise_skl) options.noise_skl.enabled = true;
  for (const char* key : {"loss_type", "regularizations"}) args.ignore(key);

  for (const std::string& path : args.texts("lpips_weights", {})) options.lpips_weights.emplace_back(path);
  options.skin_ae_run = args.text("skin_ae_run", "");
  options.skin_vertices = args.integer("skin_vertices", options.skin_vertices, 0);
  options.memory_budget_mb = args.integer("memory_budget_mb", options.memory_budget_mb, 0, 1 << 24);
  options.eval_max_assets = args.integer("eval_max_assets", options.eval_max_assets, 0);
  options.eval_surface_points = args.integer("eval_surface_points", options.eval_surface_points, 1, 1 << 24);
  options.sample_assets = args.integer("sample_assets", options.sample_assets, 0, 64);
  options.warm_start = WarmStartOptions::read(args);
  if (!options.variant.needs_skin_ae()) options.skin_ae_run.clear();
  return options;
}

}  // namespace anigen::train
