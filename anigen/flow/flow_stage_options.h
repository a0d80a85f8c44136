#pragma once
#include <cstddef>
#include <cstdint>

#include "anigen/core/config_reader.h"
#include "anigen/flow/sampler.h"
#include "anigen/flow/time_schedule.h"

namespace anigen::flow {

/// Arguments that the trainers of both flows have beside those all trainers share (reference training-and-data.md,
/// 3.4).
struct FlowStageOptions {
  double p_uncond = 0.1;    ///< share of items whose condition becomes that of no picture
  TimeSchedule t_schedule;  ///< published: logit-normal, mean 1
  double sigma_min = kSigmaMin;
  // Ours.
  /// Of sample(): `sampler`, default that of the published pipeline, 25 steps; with our sigma_min.
  SamplerOptions sampler;
  std::int64_t sample_assets = 4;    ///< rows of a sheet of samples
  std::int64_t eval_max_assets = 0;  ///< held-out assets, 0: all
  std::int64_t eval_times = 4;       ///< flow times per held-out asset
  std::uint64_t seed = 0;            ///< of evaluation and samples: the trainer's

  /// All but the seed. `image_encoder` is read by make_condition_encoder().
  /// @param cfg_strength of the published pipeline in this stage
  /// @throws InputError; NotSupportedError for train_inpaint, whose model is not published
  void read_flow(ConfigReader& trainer_args, double cfg_strength);

  /// How many of the held-out assets an evaluation looks at.
  std::size_t eval_count(std::size_t held_out) const;
  /// The times (k + ½) / eval_times of an evaluation, [eval_times] fp32.
  torch::Tensor eval_grid() const;
};

}  // namespace anigen::flow
