#include "anigen/train/stages/structured_latent_flow.h"

#include <algorithm>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/numeric.h"
#include "anigen/data/latent_files.h"
#include "anigen/data/view_files.h"
#include "anigen/flow/matching.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/sparse_structure/voxel_picture.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/sampling.h"
#include "anigen/train/pictures.h"
#include "anigen/train/stage.h"
#include "anigen/train/stages/flow_stage.h"

// From a config to the stage; what the stage does is in structured_latent_flow_stage.cpp.

// Samples of a run.

namespace anigen::train {

namespace {

// TRELLIS' flow for the geometry stream; unlike those of the other models it is not called like its class.
constexpr const char* kPretrainedFlow = "AniGenSlatFlowImage";

torch::Tensor item_of_rows(const sparse::SparseTensor& voxels) {
  return voxels.support->coords().select(1, 0).to(voxels.feats.device(), torch::kInt64);
}

}  // namespace

using torch::Tensor;

StructuredLatentFlowStage::StructuredLatentFlowStage(const structured_latent::StructuredLatentFlowStageOptions& options,
                                                     Parts parts)
    : FlowStage(std::move(parts), kPretrainedFlow), options_(options) {}

std::unique_ptr<Stage> StructuredLatentFlowStage::replica() const {
  return std::make_unique<StructuredLatentFlowStage>(options_, twin());
}

StructuredLatentFlowStage::Latents StructuredLatentFlowStage::latents_of(
    const data::StructuredLatentBatch& batch) const {
  const auto voxels = [&](const data::RaggedVoxels& given) {
    const sparse::SparseTensor sparse = sparse_of(given, parts_.device);
    return sparse.with(placed(sparse.feats));
  };
  Latents latents{voxels(batch.x_0), voxels(batch.x_0_skl), Tensor()};
  if (options_.use_joint_num_cond) latents.joints_num = batch.joints_num.to(parts_.device);
  return latents;
}

StructuredLatentFlowStage::Errors StructuredLatentFlowStage::errors(const Latents& latents, const Tensor& t,
                                                                    const flow::Streams& noise,
                                                                    const Tensor& condition) {
  const double sigma = options_.sigma_min;
  const Tensor times = t.to(parts_.device);
  const auto noisy = [&](const sparse::SparseTensor& x_0, const Tensor& e) {
    return x_0.with(flow::noisy(x_0.feats, e, times.index_select(0, item_of_rows(x_0)), sigma));
  };
  const Tensor e = placed(noise[0]), e_skl = placed(noise[1]);
  const structured_latent::StructuredVelocity velocity = parts_.model->forward(
      noisy(latents.shape, e), noisy(latents.skeleton, e_skl), flow::model_time(times), condition, latents.joints_num);
  return {(velocity.x.feats - flow::velocity_target(latents.shape.feats, e, sigma)).square(),
          (velocity.x_skl.feats - flow::velocity_target(latents.skeleton.feats, e_skl, sigma)).square()};
}

Tensor StructuredLatentFlowStage::geometry_channels(const Tensor& shape) const {
  return shape.slice(1, 0, parts_.model->options().geometry.in_channels);
}

Tensor StructuredLatentFlowStage::skin_channels(const Tensor& shape) const {
  return shape.slice(1, parts_.model->options().geometry.in_channels);
}

Losses StructuredLatentFlowStage::losses(const data::Batch& batch, const LossContext& context) {
  const auto& given = dynamic_cast<const data::StructuredLatentBatch&>(batch);
  Latents latents = latents_of(given);
  const std::int64_t items = latents.shape.support->items().items();
  // In the published order: noise of the shape, times, noise of the skeleton.
  const at::Generator generator = loss_generator(context, "structured-latent flow");
  const Tensor noise = structured_latent::shape_latent_noise(parts_.model->options(), *latents.shape.support,
                                                             options_.smoothing, generator);
  const Tensor t = options_.t_schedule.sample(items, generator);
  const Tensor noise_skl = torch::randn(given.x_0_skl.feats.sizes(), generator);
  const Tensor condition = training_condition(given.cond, items, options_.p_uncond, generator);
  if (latents.joints_num.defined()) {  // last, so that the other draws are those of a run without joint counts
    const Tensor dropped = flow::draw_condition_dropout(items, options_.p_uncond_joint_num, generator);
    latents.joints_num = flow::replace_condition(latents.joints_num, dropped);
  }
  const Errors found = errors(latents, t, {noise, noise_skl}, condition);
  const Tensor mse = found.shape.mean(), mse_skl = found.skeleton.mean();
  Losses losses{mse + mse_skl,
                {{"mse", mse},
                 {"mse_skl", mse_skl},
                 {"mse_geo", geometry_channels(found.shape).detach().mean()},
                 {"mse_skin", skin_channels(found.shape).detach().mean()}}};
  const auto per_item = [&](const Tensor& rows, const sparse::SparseTensor& voxels) {
    return flow::mean_per_item(rows.detach(), item_of_rows(voxels), items);
  };
  add_time_bins(losses, "mse", per_item(found.shape, latents.shape), t);
  add_time_bins(losses, "mse_skl", per_item(found.skeleton, latents.skeleton), t);
  return losses;
}

Values StructuredLatentFlowStage::evaluate() {
  if (!parts_.held_out) return {};
  const torch::NoGradGuard no_grad;
  const data::StructuredLatentDataset& assets = *parts_.held_out;
  const std::size_t count = options_.eval_count(assets.size());
  const Tensor grid = options_.eval_grid();
  Values sums{{"mse", 0.0}, {"mse_geo", 0.0}, {"mse_skin", 0.0}, {"mse_skl", 0.0}};
  for (std::size_t i = 0; i < count; ++i) {
    const auto batch = assets.load({data::Draw{i, i}});
    const auto& given = dynamic_cast<const data::StructuredLatentBatch&>(*batch);
    const Latents latents = latents_of(given);
    const Tensor condition = condition_of(given.cond, 1);
    const at::Generator generator = nn::numbered_generator(options_.seed, "held-out structured-latent flow", i);
    // Time by time: what was worked out about the voxels serves all of them.
    for (const Tensor& t : grid.split(1)) {
      const flow::Streams noise = structured_latent::structured_latent_noise(
          parts_.model->options(), *latents.shape.support, *latents.skeleton.support, options_.smoothing, generator);
      const Errors found = errors(latents, t, noise, condition);
      const Tensor means[] = {found.shape, geometry_channels(found.shape), skin_channels(found.shape), found.skeleton};
      for (std::size_t k = 0; k < sums.size(); ++k) sums[k].second += means[k].mean().item<double>();
    }
  }
  for (auto& [name, value] : sums) value /= static_cast<double>(count) * static_cast<double>(grid.size(0));
  return sums;
}

namespace {

const FlowConfigNames& structured_latent_names() {
  static const FlowConfigNames names{
      {structured_latent::kStructuredLatentFlowClass, structured_latent::kPlainStructuredLatentFlowClass},
      "AniGenImageConditionedSparseFlowMatchingCFGTrainer",
      "AniGenImageConditionedSLat",
      "AniGenSLat"};
  return names;
}

// Says that two numbers of channels should be one.
void require_channels(std::int64_t wanted, std::int64_t found, const InputError& problem) {
  if (wanted != found) throw problem;
}

void check_stream(const structured_latent::StructuredLatentFlowStreamOptions& stream, const std::string& suffix,
                  const std::string& file, const std::string& pointer) {
  require_channels(
      stream.in_channels, stream.out_channels,
      InputError(file, pointer + "/out_channels" + suffix,
                 "a velocity has the channels of the latent: expected in_channels" + suffix + ", " +
                     std::to_string(stream.in_channels) + ", found " + std::to_string(stream.out_channels)));
}

// True when model and dataset fit is known before a run folder is touched: from the first asset.
void check_latents(const structured_latent::StructuredLatentFlowOptions& model,
                   const data::StructuredLatentDataset& data, const std::string& file, const std::string& pointer) {
  const auto batch = data.load({data::Draw{0, 0}});
  const auto& latents = dynamic_cast<const data::StructuredLatentBatch&>(*batch);
  const std::int64_t shape = latents.x_0.feats.size(1), skeleton = latents.x_0_skl.feats.size(1);
  require_channels(model.geometry.in_channels + model.skin.in_channels, shape,
                   InputError(file, pointer + "/in_channels",
                              "with in_channels_vert_skin makes " +
                                  std::to_string(model.geometry.in_channels + model.skin.in_channels) +
                                  " channels, but the dataset's latents have " + std::to_string(shape)));
  require_channels(model.skeleton.in_channels, skeleton,
                   InputError(file, pointer + "/in_channels_skl",
                              std::to_string(model.skeleton.in_channels) +
                                  ", but the dataset's skeleton latents have " + std::to_string(skeleton)));
}

void check_decoder(const structured_latent::StructuredLatentFlowOptions& model,
                   const structured_latent::StructuredLatentDecoderOptions& decoder, const nn::RunModel& run) {
  const auto check = [&](std::int64_t wanted, std::int64_t found, const char* key) {
    require_channels(wanted, found,
                     InputError(run.config.string(), run.pointer + "/" + key,
                                std::to_string(found) + ", but the flow's latents have " + std::to_string(wanted)));
  };
  check(model.geometry.in_channels, decoder.latent_channels, "latent_channels");
  check(model.skin.in_channels, decoder.latent_channels_vertskin, "latent_channels_vertskin");
  check(model.skeleton.in_channels, decoder.latent_channels_skl, "latent_channels_skl");
}

// Three switches of the same name: the trainer's needs the other two.
void check_joint_counts(const structured_latent::StructuredLatentFlowOptions& model,
                        const data::StructuredLatentOptions& reading,
                        const structured_latent::StructuredLatentFlowStageOptions& options,
                        const ConfigReader& trainer_args) {
  constexpr const char* kSwitch = "use_joint_num_cond";
  if (options.use_joint_num_cond && !model.use_joint_num_cond) {
    throw trainer_args.error(kSwitch, "needs the model's use_joint_num_cond");
  }
  if (options.use_joint_num_cond && !reading.use_joint_num_cond) {
    throw trainer_args.error(kSwitch, "needs the dataset's use_joint_num_cond");
  }
  if (model.use_joint_num_cond && !options.use_joint_num_cond) {
    log::warn("the model takes numbers of joints, but without trainer.args.{} it will be told none", kSwitch);
  }
}

}  // namespace

std::unique_ptr<Stage> make_structured_latent_flow_stage(const Json& config, const std::string& file,
                                                         ConfigReader& trainer_args, const TrainerOptions& trainer,
                                                         torch::Device device) {
  structured_latent::StructuredLatentFlowStageOptions options =
      structured_latent::StructuredLatentFlowStageOptions::read(trainer_args);
  options.seed = trainer.seed;
  auto parts =
      flow_parts<StructuredLatentFlowStage>(config, file, trainer_args, trainer, device, structured_latent_names());
  const structured_latent::StructuredLatentFlowOptions& model = parts.model->options();
  const std::string pointer = "/models/" + escaped_for_pointer(parts.name) + "/args";
  check_stream(model.geometry, "", file, pointer);
  check_stream(model.skin, "_vert_skin", file, pointer);
  check_stream(model.skeleton, "_skl", file, pointer);
  const data::StructuredLatentOptions& reading = parts.data->options();
  check_joint_counts(model, reading, options, trainer_args);
  check_latents(model, *parts.data, file, pointer);
  if (const auto decoder =
          samples_decoder(reading.slat_dec_path, reading.slat_dec_ckpt,
                          structured_latent::kStructuredLatentDecoderClass, "slat_dec_path", trainer)) {
    parts.decoder = structured_latent::load_rig_decoder(*decoder, device);
    check_decoder(model, parts.decoder->options(), *decoder);
  }
  return std::make_unique<StructuredLatentFlowStage>(options, std::move(parts));
}

namespace {

using torch::Tensor;

// A row of the sheet behind the picture: a sample twice, the asset's latents twice, the asset.
constexpr int kTilesPerAsset = 5;

struct DecodedPair {
  io::Image skeleton = empty_rig_picture(), weights = empty_rig_picture();
  std::string problem;  // why both are empty
};

// Latents as the decoder was trained with them.
DecodedPair decoded_pair(structured_latent::StructuredLatentDecoder& decoder,
                         const structured_latent::PerStream<sparse::SparseTensor>& latents) {
  DecodedPair pair;
  const auto decoded = decoder->forward(latents);
  const shape_field::ExtractedMesh mesh = decoder->extract_meshes(decoded, /*training=*/false).front();
  if (!mesh.success) {
    pair.problem = "no surface";
    return pair;
  }
  const skeleton_field::SkeletonTensors& skeleton = decoded.joints.front();
  Asset asset;
  asset.mesh = mesh_of(mesh.vertices, mesh.faces);
  set_vertex_colors(asset.mesh, mesh.attributes);
  pair.skeleton = picture_with_skeleton(asset, skeleton);
  pair.weights = picture_with_weights(
      asset, decoder->skin_weights(mesh.skin_features, skeleton, decoded.joint_features.front().features));
  return pair;
}

// An early sample may be no latent at all; the training goes on.
DecodedPair decoded_or_problem(structured_latent::StructuredLatentDecoder& decoder,
                               const structured_latent::PerStream<sparse::SparseTensor>& latents,
                               const std::string& name) {
  try {
    return decoded_pair(decoder, latents);
  } catch (const InputError& error) {
    log::warn("{}: {}", name, error.what());
    DecodedPair nothing;
    nothing.problem = "cannot be decoded";
    return nothing;
  }
}

void add_tiles(std::vector<render::Tile>& tiles, const DecodedPair& pair, const std::string& what) {
  tiles.push_back({pair.skeleton, what + (pair.problem.empty() ? "" : ": " + pair.problem)});
  tiles.push_back({pair.weights, pair.problem.empty() ? what + ", weights" : ""});
}

render::Tile tile_of_asset(const data::AssetId& id) {
  data::RigBatch rig;
  try {
    rig.append(data::read_rig_arrays(id));
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
  flow::Streams noise = structured_latent::structured_latent_noise(
      parts_.model->options(), *latents.shape.support, *latents.skeleton.support, options_.smoothing, generator);
  for (Tensor& stream : noise) stream = placed(stream);
  const structured_latent::StructuredLatentTarget target{latents.shape.support, latents.skeleton.support, condition,
                                                         latents.joints_num};
  const bool guided = parts_.encoder || latents.joints_num.defined();
  return flow::sample_flow(noise, structured_latent::structured_latent_velocities(parts_.model, target, guided),
                           options_.sampler)
      .samples;
}

void StructuredLatentFlowStage::sample(const std::filesystem::path& folder) {
  if (!parts_.decoder) return;
  const torch::NoGradGuard no_grad;
  const data::StructuredLatentDataset& assets = shown_assets();
  const data::StructuredLatentOptions& reading = assets.options();
  std::vector<render::Tile> tiles;
  const std::size_t count = std::min(static_cast<std::size_t>(options_.sample_assets), assets.assets());
  for (std::size_t i = 0; i < count; ++i) {
    const auto batch = assets.load({data::Draw{assets.item_of(i), i}});  // each asset once, however often it repeats
    const auto& given = dynamic_cast<const data::StructuredLatentBatch&>(*batch);
    const std::string name = short_id(given.ids.front());
    const Latents latents = latents_of(given);
    const auto decoded = [&](const Tensor& x, const Tensor& x_skl) {
      const Tensor rows = data::denormalised(x.to(torch::kFloat32), reading.normalization);
      return decoded_or_problem(
          parts_.decoder,
          {latents.shape.with(geometry_channels(rows)), latents.shape.with(skin_channels(rows)),
           latents.skeleton.with(data::denormalised(x_skl.to(torch::kFloat32), reading.normalization_skl))},
          name);
    };
    const flow::Streams drawn = drawn_sample(latents, condition_of(given.cond, 1), i);
    if (parts_.encoder)
      tiles.push_back(
          {sparse_structure::fitted_picture(sparse_structure::picture_of_planes(given.cond[0]), kRigPictureSize),
           name});
    add_tiles(tiles, decoded(drawn[0], drawn[1]), parts_.encoder ? "sample" : name + ": sample");
    add_tiles(tiles, decoded(latents.shape.feats, latents.skeleton.feats), "its latents");
    tiles.push_back(tile_of_asset(assets.asset(i)));
  }
  render::SheetOptions sheet;
  sheet.columns = kTilesPerAsset + (parts_.encoder ? 1 : 0);
  sheet.text_height = 11;
  io::write_png(folder / "samples.png", render::contact_sheet(tiles, sheet));
}

}  // namespace anigen::train
