#include "anigen/train/stages/structured_latent_report.h"

#include <cmath>

#include "anigen/core/config_fields.h"
#include "anigen/core/log.h"
#include "anigen/core/numeric.h"
#include "anigen/metrics/surface.h"
#include "anigen/raster/mesh_renderer.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/train/pictures.h"
#include "anigen/train/stages/structured_latent_autoencoder.h"

namespace anigen::train {

namespace {

constexpr double kBytes = 4.0;         // fp32
constexpr double kRowsPerBlock = 8.0;  // two norms, q, k, v, the attention's result, two residual sums
constexpr double kHiddenRows = 2.0;    // before and after the activation
constexpr double kChildren = 8.0;

double torso_rows(const structured_latent::StructuredLatentCoderOptions& coder, std::int64_t channels,
                  std::int64_t voxels) {
  const double per_block = kRowsPerBlock + kHiddenRows * coder.mlp_ratio;
  return static_cast<double>(coder.num_blocks * channels * voxels) * per_block;
}

double torsos(const structured_latent::StructuredLatentCoderOptions& coder, std::int64_t voxels,
              std::int64_t skeleton_voxels) {
  return torso_rows(coder, coder.model_channels, voxels) + torso_rows(coder, coder.model_channels_skin, voxels) +
         torso_rows(coder, coder.model_channels_skl, skeleton_voxels);
}

// Per fine voxel: the input twice, both convolutions, norm and activation between, skip and sum.
double subdivide(double fine_voxels, double in, double out) { return fine_voxels * (2.0 * in + 6.0 * out); }

using torch::Tensor;

constexpr double kNearPlane = 1.0, kFarPlane = 3.0;
constexpr std::int64_t kColorChannels = 3;

// Of one asset.
struct AssetCamera {
  Tensor extrinsics, intrinsics;
};

AssetCamera camera_of(const data::FeatureSkeletonBatch& batch, std::size_t asset, torch::Device device) {
  const auto row = static_cast<std::int64_t>(asset);
  return {batch.extrinsics[row].to(device), batch.intrinsics[row].to(device)};
}

raster::Rendering rendered(const Tensor& vertices, const Tensor& faces, const Tensor& attributes,
                           const AssetCamera& camera, std::int64_t edge) {
  raster::RenderOptions options;
  options.resolution = edge;
  options.near = kNearPlane;
  options.far = kFarPlane;
  return raster::render_mesh(vertices, faces, attributes, camera.extrinsics, camera.intrinsics, options);
}

// The pictures of several renderings, channels first.
class PictureStack {
 public:
  void add(const raster::Rendering& one) {
    masks_.push_back(one.mask.unsqueeze(0));
    depths_.push_back(one.depth.unsqueeze(0));
    normals_.push_back(one.normal.permute({2, 0, 1}));
  }
  shape_field::SurfacePictures stacked() const {
    return {torch::stack(masks_), torch::stack(depths_), torch::stack(normals_), Tensor()};
  }

 private:
  std::vector<Tensor> masks_, depths_, normals_;
};

Tensor selected(const Tensor& rows, const std::vector<std::size_t>& assets, torch::Device device) {
  std::vector<Tensor> chosen;
  for (const std::size_t asset : assets) chosen.push_back(rows[static_cast<std::int64_t>(asset)]);
  return torch::stack(chosen).to(device);
}

constexpr std::uint64_t kSurfaceSeed = 0;

// Evenly spaced rows where there are more than wanted; undefined: all.
Tensor evenly_chosen(std::int64_t rows, std::int64_t wanted, torch::Device device) {
  if (wanted == 0 || rows <= wanted) return Tensor();
  return (torch::arange(wanted, torch::kInt64) * rows).floor_divide(wanted).to(device);
}

constexpr int kSheetColumns = 4;

}  // namespace

std::int64_t activation_bytes(const structured_latent::StructuredLatentEncoderOptions& encoder,
                              const structured_latent::StructuredLatentDecoderOptions& decoder, std::int64_t voxels,
                              std::int64_t skeleton_voxels) {
  double numbers = torsos(encoder, voxels, skeleton_voxels) + torsos(decoder, voxels, skeleton_voxels);
  const auto width = static_cast<double>(decoder.model_channels);
  const double half = kChildren * static_cast<double>(voxels), whole = kChildren * half;
  for (const std::int64_t stream : {decoder.model_channels, decoder.model_channels_skin})
    numbers += subdivide(half, static_cast<double>(stream), width / 4.0) + subdivide(whole, width / 4.0, width / 8.0);
  numbers += 2.0 * whole * static_cast<double>(decoder.mesh_options().channels());
  return static_cast<std::int64_t>(kBytes * numbers);
}

DecodedPictures decoded_pictures(const std::vector<shape_field::ExtractedMesh>& meshes,
                                 const std::vector<std::size_t>& assets, const data::FeatureSkeletonBatch& batch,
                                 torch::Device device) {
  const std::int64_t edge = batch.image.size(-1);
  PictureStack stack;
  std::vector<Tensor> colors;
  for (const std::size_t asset : assets) {
    const shape_field::ExtractedMesh& mesh = meshes[asset];
    const raster::Rendering one =
        rendered(mesh.vertices, mesh.faces, mesh.attributes, camera_of(batch, asset, device), edge);
    stack.add(one);
    if (!one.attributes.defined()) continue;
    colors.push_back(one.attributes.slice(2, 0, kColorChannels).permute({2, 0, 1}));
  }
  DecodedPictures pictures{stack.stacked(), Tensor()};
  if (colors.size() == assets.size()) pictures.color = torch::stack(colors);
  return pictures;
}

shape_field::SurfacePictures true_pictures(const std::vector<std::size_t>& assets,
                                           const data::FeatureSkeletonBatch& batch, torch::Device device) {
  const torch::NoGradGuard no_grad;
  const std::int64_t edge = batch.image.size(-1);
  PictureStack stack;
  for (const std::size_t asset : assets) {
    stack.add(rendered(batch.rigs.vertices[asset].to(device), batch.rigs.faces[asset].to(device, torch::kInt64),
                       Tensor(), camera_of(batch, asset, device), edge));
  }
  shape_field::SurfacePictures pictures = stack.stacked();
  pictures.normal = shape_field::facing_camera(pictures.normal, selected(batch.extrinsics, assets, device),
                                               selected(batch.intrinsics, assets, device));
  return pictures;
}

Tensor mean_tsdf_loss(const std::vector<shape_field::ExtractedMesh>& meshes, const std::vector<std::size_t>& assets,
                      const shape_field::SurfacePictures& truth, const data::FeatureSkeletonBatch& batch,
                      std::int64_t resolution) {
  Tensor sum;
  for (std::size_t i = 0; i < assets.size(); ++i) {
    const shape_field::CubeField& field = meshes[assets[i]].field;
    const AssetCamera camera = camera_of(batch, assets[i], field.sdf.device());
    const Tensor one =
        shape_field::tsdf_loss(field.positions().detach(), field.sdf, truth.depth[static_cast<std::int64_t>(i)][0],
                               camera.extrinsics, camera.intrinsics, resolution);
    sum = i == 0 ? one : sum + one;
  }
  return sum / static_cast<double>(assets.size());
}

StructuredLatentAutoEncoderStageOptions StructuredLatentAutoEncoderStageOptions::read(
    ConfigReader& args, const structured_latent::StructuredLatentDecoderOptions& decoder,
    const std::string& compatibility) {
  const bool paper = compatibility == "paper";
  StructuredLatentAutoEncoderStageOptions options;
  options.variant = structured_latent::StructuredLatentVariant::read(args, decoder, compatibility);
  options.rig.skeleton = skeleton_field::SkeletonLossOptions::compatible(compatibility);
  options.rig.skeleton.confidence = options.variant.confidence;
  options.rig.true_feature_confidence = paper;
  options.geometry.extra_color_l1 = !paper;
  options.geometry.resolution = decoder.mesh_options().resolution;
  ConfigFields f(args);
  shape_field::GeometryLossOptions& geometry = options.geometry;
  geometry.set_depth_loss(args.choice("depth_loss_type", "l1", {"l1", "smooth_l1"}));
  f("lambda_depth", geometry.lambda_depth, {0.0});
  f("lambda_tsdf", geometry.lambda_tsdf, {0.0});
  f("lambda_color", geometry.lambda_color, {0.0});
  f("lambda_ssim", geometry.perceptual.lambda_ssim, {0.0});
  f("lambda_lpips", geometry.perceptual.lambda_lpips, {0.0});
  f("lambda_lost_surface", options.lambda_lost_surface, {0.0});
  f("frozen_encoder", options.frozen_encoder);
  structured_latent::RigLossOptions& rig = options.rig;
  f("lambda_joints", rig.lambda_joints, {0.0});
  f("lambda_parents", rig.lambda_parents, {0.0});
  f("lambda_skin_kl", rig.lambda_skin_kl, {0.0});
  f("lambda_skin_var", rig.lambda_skin_var, {0.0});
  f("lambda_skin_feats_l2", rig.lambda_skin_feats_l2, {0.0});
  f("lambda_skin_feats_l2_skl", rig.lambda_skin_feats_l2_skl, {0.0});
  f("alpha_conf_j", rig.skeleton.alpha_conf_j, {0.0});
  f("alpha_conf_p", rig.skeleton.alpha_conf_p, {0.0});
  f("lambda_kl", options.lambda_kl, {0.0});
  f("lambda_kl_skl", options.lambda_kl_skl, {0.0});
  options.noise.fields(f, "");
  options.noise_skl.fields(f, "_skl");
  for (const char* key : {"loss_type", "regularizations"}) args.ignore(key);

  for (const std::string& path : args.texts("lpips_weights", {})) options.lpips_weights.emplace_back(path);
  f("skin_ae_run", options.skin_ae_run);
  f("skin_vertices", options.skin_vertices, {0});
  f("memory_budget_mb", options.memory_budget_mb, {0, 1 << 24});
  f("eval_max_assets", options.eval_max_assets, {0});
  f("eval_surface_points", options.eval_surface_points, {1, 1 << 24});
  f("sample_assets", options.sample_assets, {0, 64});
  options.warm_start = WarmStartOptions::read(args);
  if (!options.variant.needs_skin_ae()) options.skin_ae_run.clear();
  return options;
}

StructuredLatentAutoEncoderStage::Reconstruction StructuredLatentAutoEncoderStage::reconstruct(std::size_t index) {
  const torch::NoGradGuard no_grad;
  const auto batch = held_out_->load({{index, static_cast<std::uint64_t>(index)}});
  Reconstruction made;
  made.id = batch->ids.front();
  made.inputs = inputs_of(dynamic_cast<const data::FeatureSkeletonBatch&>(*batch));
  made.latents = encode(made.inputs, nullptr);
  made.decoded = decoder_->forward(streams_of(made.latents), made.inputs.skeletons);
  made.meshes = decoder_->extract_meshes(made.decoded, /*training=*/false);
  // Votes that nothing trained may be as many joints as there are voxels.
  made.grouped = options_.variant.geometry_only
                     ? made.inputs.skeletons.front()
                     : skeleton_field::group_votes(
                           structured_latent::for_grouping(made.decoded.skeletons.front(), options_.variant.confidence),
                           coders_.decoder.grouping_strategy, structured_latent::in_form_of({}, options_.variant));
  return made;
}

Values StructuredLatentAutoEncoderStage::evaluate() {
  if (!held_out_) return {};
  const torch::NoGradGuard no_grad;
  const std::vector<std::size_t> places = looked_at(held_out_->size(), options_.eval_max_assets);
  const auto samples = static_cast<std::size_t>(options_.eval_surface_points);
  RunningMeans means;  // over the assets for which there is a value
  means.only_finite = false;
  for (const std::size_t i : places) {
    const Reconstruction made = reconstruct(i);
    const shape_field::ExtractedMesh& mesh = made.meshes.front();
    means.add("surfaces", mesh.success ? 1.0 : 0.0);
    if (mesh.success) {
      const Mesh decoded = mesh_of(mesh.vertices, mesh.faces);
      const Mesh truth = mesh_of(made.inputs.rigs.vertices.front(), made.inputs.rigs.faces.front());
      const metrics::SurfaceSamples of_decoded =
          metrics::sample_mesh(decoded, samples, kSurfaceSeed, "decoded surface");
      const metrics::SurfaceSamples of_truth = metrics::sample_mesh(truth, samples, kSurfaceSeed, "true surface");
      means.add("chamfer", metrics::chamfer_l1(metrics::cloud_distances(of_decoded.points, of_truth.points)));
    }
    if (options_.variant.geometry_only) continue;
    const Tensor chosen =
        mesh.success ? evenly_chosen(mesh.vertices.size(0), options_.skin_vertices, device_) : Tensor();
    const structured_latent::RigLosses rig =
        compare_rigs(made.inputs, made.latents, made.decoded, made.meshes, {chosen});
    means.add("joints_loss", rig.joints.item<double>());
    means.add("parents_loss", rig.parents.item<double>());
    if (mesh.success && !made.inputs.is_bad_skin.front() && options_.rig.lambda_skin_kl > 0.0)
      means.add("skin_kl_loss", rig.skin_kl.item<double>());
    const std::vector<Eigen::Vector3d> truth = nn::points_of<double>(made.inputs.skeletons.front().joints, "joints");
    const std::vector<Eigen::Vector3d> grouped = nn::points_of<double>(made.grouped.joints, "joints");
    means.add("joint_count_error", std::abs(static_cast<double>(grouped.size()) - static_cast<double>(truth.size())));
    if (!grouped.empty()) means.add("joint_chamfer", metrics::chamfer_l1(metrics::cloud_distances(grouped, truth)));
    log::debug("held out {}: {} joints of {}", made.id, grouped.size(), truth.size());
  }
  return means.means();
}

void StructuredLatentAutoEncoderStage::sample(const std::filesystem::path& folder) {
  if (!held_out_ || held_out_->size() == 0 || options_.sample_assets == 0) return;
  const torch::NoGradGuard no_grad;
  std::vector<render::Tile> tiles;
  for (const std::size_t i : looked_at(held_out_->size(), options_.sample_assets)) {
    const Reconstruction made = reconstruct(i);
    const shape_field::ExtractedMesh& mesh = made.meshes.front();
    const skeleton_field::SkeletonTensors& truth = made.inputs.skeletons.front();
    Asset given, decoded;
    given.mesh = mesh_of(made.inputs.rigs.vertices.front(), made.inputs.rigs.faces.front());
    tiles.push_back({picture_with_skeleton(given, truth), short_id(made.id) + ": truth"});
    const io::Image nothing = empty_rig_picture();
    if (!mesh.success) {
      tiles.push_back({nothing, "no surface"});
      tiles.push_back({picture_with_weights(given, made.inputs.rigs.skin.front()), "true weights"});
      tiles.push_back({nothing, ""});
      continue;
    }
    decoded.mesh = mesh_of(mesh.vertices, mesh.faces);
    set_vertex_colors(decoded.mesh, mesh.attributes);
    tiles.push_back({picture_with_skeleton(decoded, made.grouped), "reconstruction"});
    tiles.push_back({picture_with_weights(given, made.inputs.rigs.skin.front()), "true weights"});
    if (options_.variant.geometry_only) {
      tiles.push_back({nothing, ""});
      continue;
    }
    const Tensor weights =
        decoder_->skin_weights(mesh.skin_features, truth, made.decoded.joint_features.front().features);
    tiles.push_back({picture_with_weights(decoded, weights), "decoded weights"});
  }
  render::SheetOptions sheet;
  sheet.columns = kSheetColumns;
  sheet.text_height = 11;
  io::write_png(folder / "reconstructions.png", render::contact_sheet(tiles, sheet));
}

}  // namespace anigen::train
