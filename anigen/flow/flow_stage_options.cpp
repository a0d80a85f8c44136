#include "anigen/flow/flow_stage_options.h"

#include <algorithm>

#include "anigen/core/error.h"

namespace anigen::flow {
namespace {

constexpr std::int64_t kPublishedSamplerSteps = 25;

/// `sampler`, by default that of the published pipeline.
SamplerOptions samples_sampler(ConfigReader& args, double cfg_strength, double sigma_min) {
  Json sampler = {{"steps", kPublishedSamplerSteps}, {"cfg_strength", cfg_strength}};
  if (const Json* given = args.raw("sampler")) {
    const ConfigReader keys = args.object("sampler");
    if (keys.has("sigma_min"))
      throw keys.error("sigma_min", "samples take the trainer's sigma_min; leave this one out");
    sampler.update(*given);
  }
  SamplerOptions options = SamplerOptions::from_json(sampler, args.file(), args.pointer_to("sampler"));
  options.sigma_min = sigma_min;
  return options;
}

}  // namespace

void FlowStageOptions::read_flow(ConfigReader& args, double cfg_strength) {
  p_uncond = args.number("p_uncond", p_uncond, 0.0, 1.0);
  if (const Json* schedule = args.raw("t_schedule")) {
    t_schedule = TimeSchedule::from_json(*schedule, args.file(), args.pointer_to("t_schedule"));
  }
  sigma_min = args.number("sigma_min", sigma_min, 0.0, 0.5);
  if (args.boolean("train_inpaint", false)) {
    throw NotSupportedError(args.file(), args.pointer_to("train_inpaint"),
                            "train_inpaint, whose model is not published");
  }
  args.raw("p_x0_inject");  // only means something with train_inpaint

  sampler = samples_sampler(args, cfg_strength, sigma_min);
  sample_assets = args.integer("sample_assets", sample_assets, 1, 64);
  eval_max_assets = args.integer("eval_max_assets", eval_max_assets, 0);
  eval_times = args.integer("eval_times", eval_times, 1, 1000);
}

std::size_t FlowStageOptions::eval_count(std::size_t held_out) const {
  const auto most = static_cast<std::size_t>(eval_max_assets);
  return most == 0 ? held_out : std::min(most, held_out);
}

torch::Tensor FlowStageOptions::eval_grid() const {
  return (torch::arange(eval_times).to(torch::kFloat32) + 0.5) / static_cast<double>(eval_times);
}

}  // namespace anigen::flow
