#include "anigen/train/sparse_structure_flow_stage.h"

#include <algorithm>
#include <utility>

#include "anigen/flow/condition_dropout.h"
#include "anigen/flow/time_bins.h"
#include "anigen/models/sparse_structure_runs.h"
#include "anigen/train/loss_generator.h"

namespace anigen::train {
namespace {

using torch::Tensor;

/// `sampler`, by default that of the published pipeline.
flow::SamplerOptions samples_sampler(ConfigReader& args, double sigma_min) {
  Json sampler = {{"steps", 25}, {"cfg_strength", 7.5}};
  if (const Json* given = args.raw("sampler")) {
    const ConfigReader keys = args.object("sampler");
    if (keys.has("sigma_min"))
      throw keys.error("sigma_min", "samples take the trainer's sigma_min; leave this one out");
    sampler.update(*given);
  }
  flow::SamplerOptions options = flow::SamplerOptions::from_json(sampler, args.file(), args.pointer_to("sampler"));
  options.sigma_min = sigma_min;
  return options;
}

/// Means over the tenths of the time axis that have items; an empty one has no mean to log.
void add_time_bins(Losses& losses, const std::string& name, const Tensor& errors, const Tensor& t) {
  const Tensor means = flow::mean_per_time_bin(errors.detach(), t);
  const Tensor filled = torch::isfinite(means).to(torch::kCPU);
  for (std::int64_t bin = 0; bin < means.size(0); ++bin) {
    if (filled[bin].item<bool>()) losses.terms.emplace_back("bin_" + std::to_string(bin) + "." + name, means[bin]);
  }
}

}  // namespace

SparseStructureFlowStageOptions SparseStructureFlowStageOptions::read(ConfigReader& args) {
  SparseStructureFlowStageOptions options;
  options.p_uncond = args.number("p_uncond", options.p_uncond, 0.0, 1.0);
  if (const Json* schedule = args.raw("t_schedule")) {
    options.t_schedule = flow::TimeSchedule::from_json(*schedule, args.file(), args.pointer_to("t_schedule"));
  }
  options.sigma_min = args.number("sigma_min", options.sigma_min, 0.0, 0.5);
  if (args.boolean("train_inpaint", false)) {
    throw NotSupportedError(args.file(), args.pointer_to("train_inpaint"),
                            "train_inpaint, whose model is not published");
  }
  args.raw("p_x0_inject");  // only means something with train_inpaint

  options.sampler = samples_sampler(args, options.sigma_min);
  options.sample_assets = args.integer("sample_assets", options.sample_assets, 1, 64);
  options.eval_max_assets = args.integer("eval_max_assets", options.eval_max_assets, 0);
  options.eval_times = args.integer("eval_times", options.eval_times, 1, 1000);
  return options;
}

SparseStructureFlowStage::SparseStructureFlowStage(const SparseStructureFlowStageOptions& options, Parts parts)
    : options_(options), parts_(std::move(parts)) {}

std::vector<NamedModel> SparseStructureFlowStage::models() const {
  std::vector<NamedModel> all{{parts_.name, parts_.model.ptr()}};
  if (parts_.encoder) {
    if (const std::optional<NamedModel> trained = parts_.encoder->trained()) all.push_back(*trained);
  }
  return all;
}

void SparseStructureFlowStage::warm_start(const LoadedKeys& finetuned) {
  if (!parts_.model->options().use_pretrain_branch) return;
  load_pretrained(*parts_.model, {PretrainedFile{models::kSparseStructureFlowClass, ""}}, parts_.start,
                  keys_of(finetuned, parts_.name));
}

std::unique_ptr<Stage> SparseStructureFlowStage::replica() const {
  Parts twin;
  twin.name = parts_.name;
  twin.model = models::SparseStructureFlow(parts_.model->options(), nn::Init::kNone);
  twin.model->to(parts_.device);
  share_frozen_weights(*parts_.model, *twin.model);
  if (parts_.encoder) twin.encoder = parts_.encoder->replica();
  twin.data = parts_.data;
  twin.held_out = parts_.held_out;
  twin.decoder = parts_.decoder;
  twin.device = parts_.device;
  twin.start = parts_.start;
  return std::make_unique<SparseStructureFlowStage>(options_, std::move(twin));
}

Tensor SparseStructureFlowStage::condition_of(const loaders::StructureLatentBatch& latents) {
  if (parts_.encoder) return parts_.encoder->tokens(latents.cond);
  return torch::zeros({latents.x_0.size(0), 1, parts_.model->options().cond_channels}, parts_.device);
}

SparseStructureFlowStage::ItemErrors SparseStructureFlowStage::errors(const loaders::StructureLatentBatch& latents,
                                                                      const Tensor& t, const Tensor& noise,
                                                                      const Tensor& noise_skl,
                                                                      const Tensor& condition) {
  const torch::Device device = parts_.device;
  const Tensor times = t.to(device), e = noise.to(device), e_skl = noise_skl.to(device);
  const Tensor x_0 = latents.x_0.to(device), x_0_skl = latents.x_0_skl.to(device);
  const double sigma = options_.sigma_min;
  const models::Velocity velocity = parts_.model->forward(
      flow::noisy(x_0, e, times, sigma), flow::noisy(x_0_skl, e_skl, times, sigma), flow::model_time(times), condition);
  return {flow::mse_per_item(velocity.shape, flow::velocity_target(x_0, e, sigma)),
          flow::mse_per_item(velocity.skeleton, flow::velocity_target(x_0_skl, e_skl, sigma))};
}

Losses SparseStructureFlowStage::losses(const loaders::Batch& batch, const LossContext& context) {
  const auto& latents = dynamic_cast<const loaders::StructureLatentBatch&>(batch);
  // In the published order: noise of the shape, noise of the skeleton, times.
  const at::Generator generator = loss_generator(context, "sparse-structure flow");
  const Tensor noise = torch::randn(latents.x_0.sizes(), generator);
  const Tensor noise_skl = torch::randn(latents.x_0_skl.sizes(), generator);
  const std::int64_t items = latents.x_0.size(0);
  const Tensor t = options_.t_schedule.sample(items, generator);
  Tensor condition = condition_of(latents);
  if (parts_.encoder) {
    const Tensor dropped = flow::draw_condition_dropout(items, options_.p_uncond, generator);
    condition = flow::replace_condition(condition, dropped.to(condition.device()));
  }
  const ItemErrors found = errors(latents, t, noise, noise_skl, condition);
  const Tensor mse = found.shape.mean(), mse_skl = found.skeleton.mean();
  Losses losses{mse + mse_skl, {{"mse", mse}, {"mse_skl", mse_skl}}};
  const Tensor times = t.to(found.shape.device());
  add_time_bins(losses, "mse", found.shape, times);
  add_time_bins(losses, "mse_skl", found.skeleton, times);
  return losses;
}

Values SparseStructureFlowStage::evaluate() {
  if (!parts_.held_out) return {};
  const torch::NoGradGuard no_grad;
  const loaders::StructureLatentDataset& assets = *parts_.held_out;
  const auto most = static_cast<std::size_t>(options_.eval_max_assets);
  const std::size_t count = most == 0 ? assets.size() : std::min(most, assets.size());
  const std::int64_t times = options_.eval_times;
  const Tensor t = (torch::arange(times).to(torch::kFloat32) + 0.5) / static_cast<double>(times);
  double mse = 0.0, mse_skl = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    const auto batch = assets.load({loaders::Draw{i, i}});
    auto latents = dynamic_cast<const loaders::StructureLatentBatch&>(*batch);
    const Tensor condition = condition_of(latents);  // once: the model takes it for all times
    latents.x_0 = latents.x_0.expand({times, -1, -1, -1, -1}).contiguous();
    latents.x_0_skl = latents.x_0_skl.expand({times, -1, -1, -1, -1}).contiguous();
    const at::Generator generator = numbered_generator(options_.seed, "held-out flow", i);
    const Tensor noise = torch::randn(latents.x_0.sizes(), generator);
    const Tensor noise_skl = torch::randn(latents.x_0_skl.sizes(), generator);
    const ItemErrors found = errors(latents, t, noise, noise_skl, condition);
    mse += found.shape.mean().item<double>();
    mse_skl += found.skeleton.mean().item<double>();
  }
  return {{"mse", mse / static_cast<double>(count)}, {"mse_skl", mse_skl / static_cast<double>(count)}};
}

}  // namespace anigen::train
