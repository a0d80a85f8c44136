#include "anigen/structured_latent/flow.h"

#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/data/latent_files.h"
#include "anigen/data/view_files.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/sparse_structure/voxel_picture.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/sampling.h"
#include "anigen/train/pictures.h"
#include "anigen/train/stages/flow_stage.h"

namespace anigen::train {

namespace {

using data::StructuredLatentBatch;
using sparse::SparseTensor;
using torch::Tensor;

// TRELLIS' flow for the geometry stream; unlike those of the other models it is not called like its class.
constexpr const char* kPretrainedFlow = "AniGenSlatFlowImage";

Tensor item_of_rows(const SparseTensor& voxels) { return voxels.support->items().item_of_rows(voxels.feats.device()); }

void check_stream(const structured_latent::StructuredLatentFlowStreamOptions& stream, const std::string& suffix,
                  const std::string& file, const std::string& pointer) {
  OptionCheck{file, pointer}(stream.in_channels == stream.out_channels, "out_channels" + suffix,
                             "a velocity has the channels of the latent: expected in_channels" + suffix + ", " +
                                 std::to_string(stream.in_channels) + ", found " + std::to_string(stream.out_channels));
}

// True when model and dataset fit is known before a run folder is touched: from the first asset.
void check_latents(const structured_latent::StructuredLatentFlowOptions& model,
                   const data::StructuredLatentDataset& data, const std::string& file, const std::string& pointer) {
  const auto batch = data.load({data::Draw{0, 0}});
  const auto& latents = dynamic_cast<const data::StructuredLatentBatch&>(*batch);
  const std::int64_t shape = latents.x_0.feats.size(1), skeleton = latents.x_0_skl.feats.size(1);
  const std::int64_t wanted = model.geometry.in_channels + model.skin.in_channels;
  const OptionCheck check{file, pointer};
  check(wanted == shape, "in_channels",
        "with in_channels_vert_skin makes " + std::to_string(wanted) + " channels, but the dataset's latents have " +
            std::to_string(shape));
  check(model.skeleton.in_channels == skeleton, "in_channels_skl",
        std::to_string(model.skeleton.in_channels) + ", but the dataset's skeleton latents have " +
            std::to_string(skeleton));
}

void check_decoder(const structured_latent::StructuredLatentFlowOptions& model,
                   const structured_latent::StructuredLatentDecoderOptions& decoder, const nn::RunModel& run) {
  const std::string file = run.config.string();
  const auto check = [&](std::int64_t wanted, std::int64_t found, const char* key) {
    OptionCheck{file, run.pointer}(wanted == found, key,
                                   std::to_string(found) + ", but the flow's latents have " + std::to_string(wanted));
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
  if (options.use_joint_num_cond && !model.use_joint_num_cond)
    throw trainer_args.error(kSwitch, "needs the model's use_joint_num_cond");
  if (options.use_joint_num_cond && !reading.use_joint_num_cond)
    throw trainer_args.error(kSwitch, "needs the dataset's use_joint_num_cond");
  if (model.use_joint_num_cond && !options.use_joint_num_cond) {
    log::warn("the model takes numbers of joints, but without trainer.args.{} it will be told none", kSwitch);
  }
}

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

// The shape alone, in its colours; without weights.
DecodedPair decoded_shape(structured_latent::StructuredLatentDecoder& decoder, const SparseTensor& geometry) {
  DecodedPair pair;
  const shape_field::ExtractedMesh mesh = decoder->decode_shapes(geometry).front();
  if (!mesh.success) {
    pair.problem = "no surface";
    return pair;
  }
  Asset asset;
  asset.mesh = mesh_of(mesh.vertices, mesh.faces);
  set_vertex_colors(asset.mesh, mesh.attributes);
  pair.skeleton = picture_with_skeleton(asset, {torch::zeros({0, 3}), torch::zeros({0}, torch::kInt64)});
  return pair;
}

// An early sample may be no latent at all; the training goes on.
DecodedPair decoded_or_problem(structured_latent::StructuredLatentDecoder& decoder,
                               const structured_latent::PerStream<sparse::SparseTensor>& latents, bool shape_alone,
                               const std::string& name) {
  try {
    return shape_alone ? decoded_shape(decoder, latents.geometry) : decoded_pair(decoder, latents);
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

class StructuredLatentFlowStage final
    : public FlowStage<structured_latent::StructuredLatentFlow, data::StructuredLatentDataset, StructuredLatentBatch,
                       structured_latent::StructuredLatentDecoder, structured_latent::StructuredLatentFlowStageOptions,
                       std::vector<render::Tile>> {
 public:
  using FlowStage::FlowStage;

  std::unique_ptr<Stage> replica() const override {
    return std::make_unique<StructuredLatentFlowStage>(options_, twin(), kPretrainedFlow);
  }

 private:
  // The latents of a batch, on the device.
  struct Latents {
    SparseTensor shape, skeleton;
    Tensor joints_num;  // [B]; undefined where the model is told nothing
  };
  // Squared errors of a batch, [N, C] and [M, C'], and the latents that it was told apart from noise.
  struct Errors {
    Tensor shape, skeleton;
    flow::Streams predicted;
  };
  // Scalars.
  struct RigErrors {
    Tensor votes, features;
  };

  Latents latents_of(const StructuredLatentBatch& batch) const {
    const auto voxels = [&](const data::RaggedVoxels& given) {
      const SparseTensor sparse = sparse_of(given, parts_.device);
      return sparse.with(placed(sparse.feats));
    };
    Latents latents{voxels(batch.x_0), voxels(batch.x_0_skl), Tensor()};
    if (options_.use_joint_num_cond) latents.joints_num = nn::to_device(batch.joints_num, parts_.device);
    return latents;
  }

  // (v(x_t, t, c) − v*)² of both streams: x_t = (1 − t) x_0 + (σ + (1 − σ) t) ε, v* = (1 − σ) ε − x_0.
  Errors errors(const Latents& latents, const Tensor& t, const flow::Streams& noise, const Tensor& condition) {
    const double sigma = options_.sigma_min;
    const Tensor times = nn::to_device(t, parts_.device);
    const auto times_of = [&](const SparseTensor& x) { return times.index_select(0, item_of_rows(x)); };
    const auto noisy = [&](const SparseTensor& x_0, const Tensor& e) {
      return x_0.with(flow::noisy(x_0.feats, e, times_of(x_0), sigma));
    };
    const Tensor e = placed(noise[0]), e_skl = placed(noise[1]);
    const SparseTensor x_t = noisy(latents.shape, e), x_t_skl = noisy(latents.skeleton, e_skl);
    const structured_latent::StructuredVelocity v =
        parts_.model->forward(x_t, x_t_skl, flow::model_time(times), condition, latents.joints_num);
    return {(v.x.feats - flow::velocity_target(latents.shape.feats, e, sigma)).square(),
            (v.x_skl.feats - flow::velocity_target(latents.skeleton.feats, e_skl, sigma)).square(),
            {flow::x0_from_velocity(x_t.feats, v.x.feats, times_of(x_t), sigma),
             flow::x0_from_velocity(x_t_skl.feats, v.x_skl.feats, times_of(x_t_skl), sigma)}};
  }

  // Rows of both streams as the decoder takes them: not normalised.
  structured_latent::PerStream<SparseTensor> decodable(const Latents& latents, const Tensor& x, const Tensor& x_skl) {
    const data::StructuredLatentOptions& reading = parts_.data->options();
    const Tensor z = data::denormalised(x.to(torch::kFloat32), reading.normalization);
    return {latents.shape.with(geometry_channels(z)), latents.shape.with(skin_channels(z)),
            latents.skeleton.with(data::denormalised(x_skl.to(torch::kFloat32), reading.normalization_skl))};
  }

  // Σ (f̂ − f)² / Σ (f − f̄)² of the rows of one asset.
  static Tensor missed_variance(const Tensor& found, const Tensor& own) {
    return (found - own).square().sum() / (own - own.mean(0, /*keepdim=*/true)).square().sum().clamp_min(1e-6);
  }

  // Decoded rig fields of predicted latents against those of the asset's own latents, which vote within 0.003 of its
  // joints: ‖Ĵ − J‖₁ + ‖P̂ − P‖₁, means over voxels, and what is missed of the variance of skin features on both
  // supports. Σ over late items / items of the micro-batch, so that the weights do not depend on how many are late.
  RigErrors late_rig_errors(const Latents& latents, const Tensor& t, const flow::Streams& predicted) {
    const std::int64_t items = t.size(0);
    const Tensor late = (t >= options_.rig_time).to(torch::kCPU);
    if (!late.any().item<bool>()) return {};
    structured_latent::StructuredLatentDecoderImpl::RigFields own;
    {
      const torch::NoGradGuard no_grad;
      own = parts_.decoder->rig_fields(decodable(latents, latents.shape.feats, latents.skeleton.feats));
    }
    const auto found = parts_.decoder->rig_fields(decodable(latents, predicted[0], predicted[1]));
    const std::vector<Tensor> skin = found.skin.support->items().split(found.skin.feats),
                              own_skin = own.skin.support->items().split(own.skin.feats);
    const auto apart = [](const Tensor& a, const Tensor& b) { return (a - b).abs().sum(1).mean(); };
    RigErrors errors{torch::zeros({}, parts_.device), torch::zeros({}, parts_.device)};
    for (std::int64_t i = 0; i < items; ++i) {
      if (!late[i].item<bool>()) continue;
      const auto at = static_cast<std::size_t>(i);
      const skeleton_field::SkeletonField &votes = found.skeletons[at], &own_votes = own.skeletons[at];
      errors.votes = errors.votes + apart(votes.joints, own_votes.joints) + apart(votes.parents, own_votes.parents);
      errors.features = errors.features + missed_variance(votes.skin_features, own_votes.skin_features) +
                        missed_variance(skin[at], own_skin[at]);
    }
    return {errors.votes / static_cast<double>(items), errors.features / static_cast<double>(items)};
  }

  Tensor geometry_channels(const Tensor& shape) const {
    return shape.slice(1, 0, parts_.model->options().geometry.in_channels);
  }
  Tensor skin_channels(const Tensor& shape) const {
    return shape.slice(1, parts_.model->options().geometry.in_channels);
  }
  bool shape_alone() const { return parts_.model->options().geometry_only; }
  flow::Streams noise_on(const Latents& latents, const at::Generator& generator) const {
    return structured_latent::structured_latent_noise(parts_.model->options(), *latents.shape.support,
                                                      *latents.skeleton.support, options_.smoothing, generator);
  }

  Losses loss(const StructuredLatentBatch& given, const LossContext& context) override {
    Latents latents = latents_of(given);
    const std::int64_t items = latents.shape.support->items().items();
    // In the published order: noise of the shape, times, noise of the skeleton.
    const at::Generator generator = loss_generator(context, "structured-latent flow");
    const Tensor noise = structured_latent::shape_latent_noise(parts_.model->options(), *latents.shape.support,
                                                               options_.smoothing, generator);
    const Tensor t = options_.t_schedule.sample(items, generator);
    const Tensor noise_skl = torch::randn(given.x_0_skl.feats.sizes(), generator);
    const Tensor condition = training_condition(given.cond, items, generator);
    if (latents.joints_num.defined()) {  // last, so that the other draws are those of a run without joint counts
      const Tensor dropped = flow::draw_condition_dropout(items, options_.p_uncond_joint_num, generator);
      latents.joints_num = flow::replace_condition(latents.joints_num, dropped);
    }
    const Errors found = errors(latents, t, {noise, noise_skl}, condition);
    const auto per_item = [&](const Tensor& rows, const SparseTensor& voxels) {
      return flow::mean_per_item(rows.detach(), item_of_rows(voxels), items);
    };
    if (shape_alone()) {
      const Tensor geometry = geometry_channels(found.shape), mse_geo = geometry.mean();
      Losses losses{mse_geo, {{"mse_geo", mse_geo}}};
      add_time_bins(losses, "mse_geo", per_item(geometry, latents.shape), t);
      return losses;
    }
    const Tensor mse = found.shape.mean(), mse_skl = found.skeleton.mean();
    Losses losses{mse + mse_skl,
                  {{"mse", mse},
                   {"mse_skl", mse_skl},
                   {"mse_geo", geometry_channels(found.shape).detach().mean()},
                   {"mse_skin", skin_channels(found.shape).detach().mean()}}};
    if (options_.lambda_votes > 0.0 || options_.lambda_rig_features > 0.0) {
      const RigErrors rig = late_rig_errors(latents, t, found.predicted);
      if (rig.votes.defined()) {
        losses.total = losses.total + options_.lambda_votes * rig.votes + options_.lambda_rig_features * rig.features;
        losses.terms.emplace_back("votes", rig.votes);
        losses.terms.emplace_back("rig_features", rig.features);
      }
    }
    add_time_bins(losses, "mse", per_item(found.shape, latents.shape), t);
    add_time_bins(losses, "mse_skl", per_item(found.skeleton, latents.skeleton), t);
    return losses;
  }

  double judge(const StructuredLatentBatch& given, const Tensor& condition, std::uint64_t index,
               Values& sums) override {
    if (sums.empty() && shape_alone()) sums = {{"mse_geo", 0.0}};
    if (sums.empty()) sums = {{"mse", 0.0}, {"mse_geo", 0.0}, {"mse_skin", 0.0}, {"mse_skl", 0.0}};
    const Latents latents = latents_of(given);
    const Tensor grid = options_.eval_grid();
    const at::Generator generator = nn::numbered_generator(options_.seed, "held-out structured-latent flow", index);
    // Time by time: what was worked out about the voxels serves all of them.
    for (const Tensor& t : grid.split(1)) {
      const Errors found = errors(latents, t, noise_on(latents, generator), condition);
      const Tensor geometry = geometry_channels(found.shape);
      std::vector<Tensor> means{geometry};
      if (!shape_alone()) means = {found.shape, geometry, skin_channels(found.shape), found.skeleton};
      for (std::size_t k = 0; k < sums.size(); ++k) sums[k].second += means[k].mean().item<double>();
    }
    return static_cast<double>(grid.size(0));
  }

  flow::Streams drawn_sample(const Latents& latents, const Tensor& condition, std::uint64_t number) {
    const at::Generator generator = nn::numbered_generator(options_.seed, "structured-latent sample", number);
    flow::Streams noise = noise_on(latents, generator);
    for (Tensor& stream : noise) stream = placed(stream);
    const structured_latent::StructuredLatentTarget target{latents.shape.support, latents.skeleton.support, condition,
                                                           latents.joints_num};
    const bool guided = parts_.encoder || latents.joints_num.defined();
    const auto velocities = structured_latent::structured_latent_velocities(parts_.model, target, guided);
    return flow::sample_flow(noise, velocities, options_.sampler).samples;
  }

  void add_sample(const StructuredLatentBatch& given, const Tensor& condition, const data::AssetId& asset,
                  std::uint64_t index, std::vector<std::vector<render::Tile>>& rows) override {
    const std::string name = short_id(given.ids.front());
    const Latents latents = latents_of(given);
    const auto decoded = [&](const Tensor& x, const Tensor& x_skl) {
      return decoded_or_problem(parts_.decoder, decodable(latents, x, x_skl), shape_alone(), name);
    };
    const flow::Streams drawn = drawn_sample(latents, condition, index);
    std::vector<render::Tile>& tiles = rows.emplace_back();
    if (parts_.encoder) {
      const io::Image picture = sparse_structure::picture_of_planes(given.cond[0]);
      tiles.push_back({sparse_structure::fitted_picture(picture, kRigPictureSize), name});
    }
    add_tiles(tiles, decoded(drawn[0], drawn[1]), parts_.encoder ? "sample" : name + ": sample");
    add_tiles(tiles, decoded(latents.shape.feats, latents.skeleton.feats), "its latents");
    tiles.push_back(tile_of_asset(asset));
  }

  void write_sheet(const std::filesystem::path& file,
                   const std::vector<std::vector<render::Tile>>& rows) const override {
    std::vector<render::Tile> tiles;
    for (const std::vector<render::Tile>& row : rows) tiles.insert(tiles.end(), row.begin(), row.end());
    render::SheetOptions sheet;
    sheet.columns = static_cast<int>(rows.front().size());
    sheet.text_height = 11;
    io::write_png(file, render::contact_sheet(tiles, sheet));
  }
};

}  // namespace

std::unique_ptr<Stage> make_structured_latent_flow_stage(const StageRequest& request) {
  const FlowConfigNames names{
      {structured_latent::kStructuredLatentFlowClass, structured_latent::kPlainStructuredLatentFlowClass},
      "AniGenImageConditionedSparseFlowMatchingCFGTrainer",
      "AniGenImageConditionedSLat",
      "AniGenSLat"};
  auto [options, parts] =
      flow_parts<StructuredLatentFlowStage, structured_latent::StructuredLatentFlowStageOptions,
                 structured_latent::StructuredLatentFlowOptions, data::StructuredLatentDataset>(request, names);
  const structured_latent::StructuredLatentFlowOptions& model = parts.model->options();
  for (const auto& [key, weight] : {std::pair("lambda_votes", options.lambda_votes),
                                    std::pair("lambda_rig_features", options.lambda_rig_features)}) {
    if (weight > 0.0 && model.geometry_only)
      throw InputError(request.file, std::string("/trainer/args/") + key,
                       "with geometry_only there is no rig to judge");
  }
  const std::string pointer = "/models/" + escaped_for_pointer(parts.name) + "/args";
  check_stream(model.geometry, "", request.file, pointer);
  check_stream(model.skin, "_vert_skin", request.file, pointer);
  check_stream(model.skeleton, "_skl", request.file, pointer);
  const data::StructuredLatentOptions& reading = parts.data->options();
  check_joint_counts(model, reading, options, request.args);
  check_latents(model, *parts.data, request.file, pointer);
  if (const auto decoder =
          samples_decoder(reading.slat_dec_path, reading.slat_dec_ckpt,
                          structured_latent::kStructuredLatentDecoderClass, "slat_dec_path", request.trainer)) {
    parts.decoder = model.geometry_only
                        ? nn::load_trained<structured_latent::StructuredLatentDecoder>(*decoder, request.device)
                        : structured_latent::load_rig_decoder(*decoder, request.device);
    check_decoder(model, parts.decoder->options(), *decoder);
  }
  if ((options.lambda_votes > 0.0 || options.lambda_rig_features > 0.0) && parts.decoder.is_empty()) {
    throw InputError(
        request.file,
        "/trainer/args/" + std::string(options.lambda_votes > 0.0 ? "lambda_votes" : "lambda_rig_features"),
        "needs the decoder of latents: name its run in dataset.args.slat_dec_path, and draw samples "
        "(i_sample)");
  }
  return std::make_unique<StructuredLatentFlowStage>(options, std::move(parts), kPretrainedFlow);
}

}  // namespace anigen::train
