#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/flow/matching.h"

namespace anigen::flow {

/// The state of a flow: one tensor per stream. Two dense latents for the sparse structure; for structured latents the
/// features [N, C] of sparse tensors, whose coordinates the velocity function knows.
using Streams = std::vector<Tensor>;

/// The velocity of every stream at a state. @param time float32(1000 t), the same for all items
using VelocityFunction = std::function<Streams(const Streams& x, float time)>;

/// A model under its condition and, for guidance, under the negative one: zeros for an image, 0 joints for a joint
/// count. What differs between the two passes is the business of the two functions.
struct Velocities {
  VelocityFunction conditional;
  VelocityFunction unconditional = nullptr;  ///< none: sampling without guidance
  /// Called before each step with its number, from 0; none: no velocity depends on it.
  std::function<void(std::int64_t step)> step_begins = nullptr;
  std::size_t conditions = 2;  ///< that models are asked with in turn, the negative one too (nn::ConditionCache)
};

/// Integration rule of a step from t to t'. The published sampler is Euler's; the error of the other three falls with
/// the square of the step instead of with the step. Midpoint and Heun ask for the velocity twice per step.
enum class Solver {
  kEuler,     ///< along the velocity at t
  kMidpoint,  ///< along the velocity half way, where Euler's half step leads
  kHeun,      ///< along the mean of the velocities at t and where Euler's step leads; the last step, to t = 0, is
              ///< Euler's: models that predict the data have no velocity there (Karras et al. 2022, algorithm 1)
  kAdams,     ///< along the velocity at t and its change since the step before, whose velocity is kept: two-step
              ///< Adams–Bashforth; the first step is Euler's
};

/// Names in configs and on command lines: euler, midpoint, heun, adams. @throws InputError for another word
Solver parse_solver(const std::string& word);
const std::string& word_of(Solver solver);

/// Defaults of the published sampler class; its pipeline takes 25 steps with strength 7.5 for the sparse structure and
/// 3.0 for structured latents (docs/reference/flows.md, 4.3).
struct SamplerOptions : JsonOptions<SamplerOptions> {
  std::int64_t steps = 50;
  Solver solver = Solver::kEuler;
  double rescale_t = 1.0;     ///< r of t → r t / (1 + (r − 1) t); above 1: more steps near the noise
  double cfg_strength = 3.0;  ///< s of (1 + s) v − s v_neg: the *extra* weight, 7.5 is a guidance scale of 8.5
  /// Guidance only where low ≤ t ≤ high, after rescaling; elsewhere one conditional pass. Unset: at every step.
  std::optional<std::pair<double, double>> cfg_interval;
  double sigma_min = kSigmaMin;
  // Ours: fewer or cheaper passes through the model. All are off by default, as published.
  /// The unconditional pass runs in every so many guided steps; between, the difference v − v_neg that it gave is kept.
  std::int64_t cfg_every = 1;
  /// A step takes the velocity that the line through the last two predicts, when the last prediction was off by no more
  /// than this share of the velocity's norm, in every stream; never two such steps in a row, and never the last one.
  /// 0: every step asks.
  double velocity_tolerance = 0.0;
  /// Self attention stays inside windows of `window`³ places (nn::AttentionWindows) in so many first steps. What they
  /// leave for cfg_every and velocity_tolerance ends with them.
  std::int64_t windowed_steps = 0;
  std::int64_t window = 8;

  void fields(ConfigFields& f);
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

/// Known values, kept while the rest is sampled: after each step x ← (1 − m) x + m x_t(known).
struct Inpainting {
  Streams x_0;    ///< the known latent
  Streams noise;  ///< its noise
  Streams mask;   ///< 1 keeps the known value; broadcast to the stream
};

struct SamplingExtras {
  const Inpainting* inpainting = nullptr;
  bool trajectory = false;  ///< keep every step's state and prediction
  /// Called after each step; whatever it throws ends the sampling.
  std::function<void(std::int64_t step, std::int64_t steps)> progress = nullptr;
};

struct Sampled {
  Streams samples;           ///< the state after the last step, at t = 0
  std::vector<Streams> x_t;  ///< the state after each step, if asked for
  std::vector<Streams> x_0;  ///< the prediction of the data at each step, if asked for
  std::int64_t passes = 0;   ///< through the model, conditional and unconditional ones
};

/// Integration from noise to data along the time grid, by default Euler's: x ← x − (t − t') v (docs/reference/flows.md,
/// 4.3). Step sizes are formed in double. With an unconditional velocity both passes run even at strength 0; whether a
/// velocity is guided is decided at the time it is asked for. The trajectory's x_0 is the prediction at the beginning
/// of each step. No gradient is recorded.
/// @param noise the state at t = 1 @return the samples, and the trajectory when asked for
Sampled sample_flow(const Streams& noise, const Velocities& velocities, const SamplerOptions& options,
                    const SamplingExtras& extras = {});

/// The steps + 1 times from 1 to 0, rescaled.
std::vector<double> time_grid(const SamplerOptions& options);

/// Arguments that the trainers of both flows have beside those all trainers share (docs/reference/training.md, 3.6).
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
  /// False: times evenly between 0 and 1; true: as the training draws them, so that a flow that learns late times alone
  /// is not judged where it knows nothing.
  bool eval_on_schedule = false;
  std::uint64_t seed = 0;  ///< of evaluation and samples: the trainer's

  /// All but the seed. `image_encoder` is read by make_condition_encoder().
  /// @param cfg_strength of the published pipeline in this stage
  /// @throws NotSupportedError for train_inpaint, whose model is not published
  void flow_fields(ConfigFields& f, double cfg_strength);

  /// Times of an evaluation, [eval_times] fp32: (k + ½) / eval_times, with eval_on_schedule these quantiles of
  /// t_schedule.
  torch::Tensor eval_grid() const;
};

}  // namespace anigen::flow
