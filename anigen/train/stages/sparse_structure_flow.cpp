#include "anigen/sparse_structure/flow.h"

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/data/latent_files.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/voxel_picture.h"
#include "anigen/train/stages/flow_stage.h"

namespace anigen::train {

namespace {

using data::StructureLatentBatch;
using sparse_structure::VoxelSheetRow;
using torch::Tensor;

class SparseStructureFlowStage final
    : public FlowStage<sparse_structure::SparseStructureFlow, data::StructureLatentDataset, StructureLatentBatch,
                       sparse_structure::SparseStructureDecoder, sparse_structure::SparseStructureFlowStageOptions,
                       VoxelSheetRow> {
 public:
  using FlowStage::FlowStage;

  std::unique_ptr<Stage> replica() const override {
    return std::make_unique<SparseStructureFlowStage>(options_, twin(), sparse_structure::kSparseStructureFlowClass);
  }

 private:
  // Squared error of each item of a batch, [B] per stream, and the latents that it was told apart from noise.
  struct ItemErrors {
    Tensor shape, skeleton;
    flow::Streams predicted;
  };

  // ‖v(x_t, t, c) − v*‖² of both streams: x_t = (1 − t) x_0 + (σ + (1 − σ) t) ε, v* = (1 − σ) ε − x_0.
  // Given shapes stay x_0 and count for nothing. @param given [B] bool; undefined: none
  ItemErrors errors(const StructureLatentBatch& latents, const Tensor& t, const flow::Streams& noise,
                    const Tensor& condition, const Tensor& given) {
    const Tensor times = nn::to_device(t, parts_.device), e = placed(noise[0]), e_skl = placed(noise[1]);
    const Tensor x_0 = placed(latents.x_0), x_0_skl = placed(latents.x_0_skl);
    const double sigma = options_.sigma_min;
    Tensor x_t = flow::noisy(x_0, e, times, sigma);
    const Tensor x_t_skl = flow::noisy(x_0_skl, e_skl, times, sigma);
    const Tensor is_given = given.defined() ? nn::to_device(given, parts_.device) : Tensor();
    if (given.defined()) x_t = torch::where(is_given.view({-1, 1, 1, 1, 1}), x_0, x_t);
    const sparse_structure::Velocity v = parts_.model->forward(x_t, x_t_skl, flow::model_time(times), condition);
    Tensor shape = flow::mse_per_item(v.shape, flow::velocity_target(x_0, e, sigma));
    if (given.defined()) shape = shape.masked_fill(is_given, 0.0);
    return {shape,
            flow::mse_per_item(v.skeleton, flow::velocity_target(x_0_skl, e_skl, sigma)),
            {flow::x0_from_velocity(x_t, v.shape, times, sigma),
             flow::x0_from_velocity(x_t_skl, v.skeleton, times, sigma)}};
  }

  // Both grids that latents decode to, before anything is decided.
  sparse_structure::SparseStructureDecoderImpl::Logits decoded(const Tensor& z, const Tensor& z_skl) {
    const data::StructureLatentOptions& reading = parts_.data->options();
    const auto latent = [&](const Tensor& x, const data::ChannelStatistics& statistics) {
      return data::denormalised(nn::to_device(x, parts_.device).to(torch::kFloat32), statistics);
    };
    return parts_.decoder->forward(latent(z, reading.normalization), latent(z_skl, reading.normalization_skl));
  }

  // 1 − 2 Σ p o / (Σ p + Σ o) of each item, p the predicted share of a voxel, o 1 where the asset's own latent has one.
  static Tensor dice_loss(const Tensor& logits, const Tensor& own) {
    const Tensor p = logits.sigmoid().flatten(1), o = (own > 0).to(p.scalar_type()).flatten(1);
    return 1.0 - 2.0 * (p * o).sum(1) / (p.sum(1) + o.sum(1)).clamp_min(1e-6);
  }

  // Σ over late items / items of the micro-batch, so that its weight does not depend on how many are late.
  Tensor late_dice(const StructureLatentBatch& latents, const Tensor& t, const flow::Streams& predicted,
                   const Tensor& given) {
    const Tensor late = (t >= options_.dice_time).nonzero().squeeze(1);
    if (late.numel() == 0) return {};
    const auto rows = [&](const Tensor& x) { return x.index_select(0, nn::to_device(late, x.device())); };
    sparse_structure::SparseStructureDecoderImpl::Logits own;
    {
      const torch::NoGradGuard no_grad;
      own = decoded(rows(latents.x_0), rows(latents.x_0_skl));
    }
    const auto found = decoded(rows(predicted[0]), rows(predicted[1]));
    Tensor shape = dice_loss(found.shape, own.shape);
    if (given.defined()) shape = shape.masked_fill(rows(nn::to_device(given, parts_.device)), 0.0);
    if (shape_alone()) return shape.sum() / static_cast<double>(t.size(0));
    return (shape + dice_loss(found.skeleton, own.skeleton)).sum() / static_cast<double>(t.size(0));
  }

  // Noise of the shape, then of the skeleton, as published.
  static flow::Streams noise_like(const StructureLatentBatch& latents, const at::Generator& generator) {
    const Tensor shape = torch::randn(latents.x_0.sizes(), generator);
    return {shape, torch::randn(latents.x_0_skl.sizes(), generator)};
  }

  Losses loss(const StructureLatentBatch& latents, const LossContext& context) override {
    // In the published order: noise, then times.
    const at::Generator generator = loss_generator(context, "sparse-structure flow");
    const flow::Streams noise = noise_like(latents, generator);
    const std::int64_t items = latents.x_0.size(0);
    const Tensor t = options_.t_schedule.sample(items, generator);
    const Tensor condition = training_condition(latents.cond, items, generator);
    Tensor given;  // drawn last, so that the other draws are those of a run without
    if (options_.p_given_shape > 0.0) given = flow::draw_condition_dropout(items, options_.p_given_shape, generator);
    const ItemErrors found = errors(latents, t, noise, condition, given);
    const Tensor mse = found.shape.mean();
    Losses losses{mse, {{"mse", mse}}};
    if (!shape_alone()) {
      const Tensor mse_skl = found.skeleton.mean();
      losses = {mse + mse_skl, {{"mse", mse}, {"mse_skl", mse_skl}}};
    }
    if (options_.lambda_dice > 0.0 && context.step >= options_.dice_from_step) {
      const Tensor dice = late_dice(latents, t, found.predicted, given);
      if (dice.defined()) {
        losses.total = losses.total + options_.lambda_dice * dice;
        losses.terms.emplace_back("dice", dice);
      }
    }
    add_time_bins(losses, "mse", found.shape, t);
    if (!shape_alone()) add_time_bins(losses, "mse_skl", found.skeleton, t);
    return losses;
  }

  bool shape_alone() const { return parts_.model->options().geometry_only; }

  // Held-out shapes are given where all of the training's are.
  Tensor all_given(std::int64_t items) const {
    return options_.p_given_shape == 1.0 ? torch::ones({items}, torch::kBool) : Tensor();
  }

  double judge(const StructureLatentBatch& read, const Tensor& condition, std::uint64_t index, Values& sums) override {
    if (sums.empty() && shape_alone()) sums = {{"mse", 0.0}};
    if (sums.empty()) sums = {{"mse", 0.0}, {"mse_skl", 0.0}};
    const Tensor t = options_.eval_grid();
    StructureLatentBatch latents = read;  // once per time
    latents.x_0 = latents.x_0.expand({t.size(0), -1, -1, -1, -1}).contiguous();
    latents.x_0_skl = latents.x_0_skl.expand({t.size(0), -1, -1, -1, -1}).contiguous();
    const flow::Streams noise = noise_like(latents, nn::numbered_generator(options_.seed, "held-out flow", index));
    const ItemErrors found = errors(latents, t, noise, condition, all_given(t.size(0)));
    sums[0].second += found.shape.mean().item<double>();
    if (!shape_alone()) sums[1].second += found.skeleton.mean().item<double>();
    return 1.0;
  }

  void add_sample(const StructureLatentBatch& latents, const Tensor& condition, const data::AssetId&,
                  std::uint64_t index, std::vector<VoxelSheetRow>& rows) override {
    const auto voxels = [&](const Tensor& z, const Tensor& z_skl) {
      const auto logits = decoded(z, z_skl);
      const auto occupied = [](const Tensor& grid) { return (grid[0][0] > 0).to(torch::kCPU).contiguous(); };
      return sparse_structure::VoxelPair{occupied(logits.shape), occupied(logits.skeleton)};
    };
    const flow::Streams noise = noise_like(latents, nn::numbered_generator(options_.seed, "flow sample", index));
    const auto drawn = [&](bool guided) {
      const bool given = options_.p_given_shape == 1.0;
      const auto velocities = sparse_structure::structure_velocities(parts_.model, condition, guided, given);
      const Tensor& first = given ? latents.x_0 : noise[0];
      const flow::Streams x =
          flow::sample_flow({placed(first), placed(noise[1])}, velocities, options_.sampler).samples;
      return voxels(x[0], x[1]);
    };
    VoxelSheetRow row;
    row.label = short_id(latents.ids.front());
    if (parts_.encoder) {
      row.picture = sparse_structure::picture_of_planes(latents.cond[0]);
      row.cells.push_back(drawn(/*guided=*/true));
    }
    row.cells.push_back(drawn(/*guided=*/false));
    row.cells.push_back(voxels(latents.x_0, latents.x_0_skl));
    rows.push_back(std::move(row));
  }

  void write_sheet(const std::filesystem::path& file, const std::vector<VoxelSheetRow>& rows) const override {
    std::vector<std::string> columns{"sample", "latents of the asset, decoded"};
    if (parts_.encoder) columns = {"sample, guided", "sample, not guided", columns.back()};
    sparse_structure::write_voxel_sheet(file, rows, columns);
  }
};

}  // namespace

std::unique_ptr<Stage> make_sparse_structure_flow_stage(const StageRequest& request) {
  const FlowConfigNames names{{sparse_structure::kSparseStructureFlowClass},
                              "AniGenImageConditionedFlowMatchingCFGTrainer",
                              "ImageConditionedAniGenSparseStructureLatent",
                              "AniGenSparseStructureLatent"};
  auto [options, parts] =
      flow_parts<SparseStructureFlowStage, sparse_structure::SparseStructureFlowStageOptions,
                 sparse_structure::SparseStructureFlowOptions, data::StructureLatentDataset>(request, names);
  if (options.p_given_shape > 0.0 && parts.model->options().geometry_only) {
    throw InputError(request.file, "/trainer/args/p_given_shape",
                     "with geometry_only there is no skeleton to find for a given shape");
  }
  const data::StructureLatentOptions& reading = parts.data->options();
  if (const auto decoder =
          samples_decoder(reading.ss_dec_path, reading.ss_dec_ckpt, sparse_structure::kSparseStructureDecoderClass,
                          "ss_dec_path", request.trainer)) {
    parts.decoder = nn::load_trained<sparse_structure::SparseStructureDecoder>(*decoder, request.device);
  }
  if (options.lambda_dice > 0.0 && parts.decoder.is_empty()) {
    throw InputError(request.file, "/trainer/args/lambda_dice",
                     "needs the decoder of latents: name its run in dataset.args.ss_dec_path, and draw samples "
                     "(i_sample)");
  }
  return std::make_unique<SparseStructureFlowStage>(options, std::move(parts),
                                                    sparse_structure::kSparseStructureFlowClass);
}

}  // namespace anigen::train
