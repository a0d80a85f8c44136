#pragma once
#include <torch/torch.h>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <variant>
#include <vector>

#include "anigen/train/parameters.h"

namespace anigen::train {

/// Learning rate as a closed form of the step (0 = first update), so that resuming needs no state: of the optimiser's
/// rate `base` and the step. Names and defaults are those of torch.optim.lr_scheduler; docs/reference/training.md, 2.2.
using LrSchedule = std::function<double(double base, std::int64_t step)>;

/// base, always: what "lr_scheduler": null means.
LrSchedule unscheduled();

/// base · (start + (end − start) · min(step, total) / total)
LrSchedule linear_lr(double start_factor, double end_factor, std::int64_t total_iters);

/// eta_min + (base − eta_min) · (1 + cos(π · step / T_max)) / 2. Past T_max the rate comes back up, as torch's does.
LrSchedule cosine_annealing_lr(std::int64_t t_max, double eta_min);

/// base · factor until total, then base
LrSchedule constant_lr(double factor, std::int64_t total_iters);

/// base · gamma^(number of milestones reached); milestones in any order
LrSchedule multi_step_lr(std::vector<std::int64_t> milestones, double gamma);

/// base · min(1, (step + 1) / warmup)
LrSchedule linear_warmup_lr(std::int64_t warmup_steps);

/// Schedule i runs from milestones[i − 1] (0 for the first) on, counting its own steps from there.
/// @throws InputError unless there is one milestone fewer than schedules and they do not decrease
LrSchedule sequential_lr(std::vector<LrSchedule> schedules, std::vector<std::int64_t> milestones);

/// Number of first steps in which two schedules have the same rate, at most `most`: where a run whose length changes
/// can go on from.
std::int64_t common_steps(const LrSchedule& one, const LrSchedule& other, double base, std::int64_t most);

/// Number of steps up to the last one at the highest rate of a run of `steps`: what comes after only falls. 0 for runs
/// of more than ten million steps.
std::int64_t steps_before_decay(const LrSchedule& schedule, double base, std::int64_t steps);

/// AdamW (Loshchilov and Hutter 2019, algorithm 2, as torch.optim.AdamW computes it) over one flat fp32 vector; or
/// Adam, whose weight decay is part of the gradient. On the CPU one pass over memory; threads do not change it.
class AdamW {
 public:
  struct Options {
    double lr = 1e-3;
    std::array<double, 2> betas{0.9, 0.999};
    double eps = 1e-8;
    double weight_decay = 1e-2;
    bool decoupled = true;  ///< false: Adam (Kingma and Ba 2015, as torch.optim.Adam)
  };

  /// @param parameters [P] fp32; only its size and device are used
  /// @throws InputError for options out of range
  AdamW(const torch::Tensor& parameters, const Options& options);

  /// parameters ← update, in place. @param gradients [P] fp32 @param gradient_factor multiplies every gradient
  /// (clipping) @param lr learning rate of this step
  void step(torch::Tensor parameters, const torch::Tensor& gradients, double gradient_factor, double lr);

  const Options& options() const { return options_; }

  /// Everything that options do not say: first and second moment [P] and the number of steps taken.
  torch::Tensor exp_avg, exp_avg_sq;
  std::int64_t steps = 0;

 private:
  Options options_;
};

/// Nearest semi-orthogonal matrix, approximately: five Newton–Schulz iterations with the quintic coefficients of
/// Jordan et al. 2024 ("Muon: an optimizer for hidden layers"). Singular values come out between about 0.7 and 1.2.
/// @param matrix [m, n] fp32 @return [m, n] fp32
torch::Tensor orthogonalize(const torch::Tensor& matrix);

/// Muon for weight matrices, AdamW for the rest (biases, embeddings, matrices with a side shorter than
/// min_side, such as first and last layers). The published trainer accepts the optimizer name `muon`, by way of a
/// package of its own (docs/reference/training.md, 2.2); no published config uses it.
///
/// Update of a matrix: momentum of the gradient, Nesterov look-ahead, orthogonalised, times
/// lr · 0.2 · sqrt(max(m, n)) so that its root mean square is that of a typical AdamW update and one learning
/// rate serves both (Liu et al. 2025, "Muon is scalable for LLM training", eq. 4).
class Muon {
 public:
  struct Options {
    double momentum = 0.95;
    std::int64_t min_side = 16;
  };

  /// @throws InputError for options out of range
  Muon(const ParameterBuffer& buffer, const Options& options);

  /// Updates buffer.master() from buffer.gradient(). @param rest updates what is no matrix; its weight decay holds for
  /// both @param gradient_factor multiplies every gradient (clipping)
  void step(ParameterBuffer& buffer, AdamW& rest, double gradient_factor, double lr);

  /// All of the state that options do not say: [P], zero where AdamW is used.
  torch::Tensor momentum;

 private:
  Options options_;
  std::vector<std::size_t> matrices_;  // slots that Muon updates
};

/// Clips the gradient's norm at a percentile of the recent norms (docs/reference/training.md, 2.3).
///
/// The threshold starts at max_norm (or none). Once `buffer_size` finite norms were seen it is, from the next call
/// on, the percentile of the last `buffer_size` unclipped norms, and never above max_norm.
class AdaptiveGradClipper {
 public:
  struct Options {
    std::optional<double> max_norm;
    double clip_percentile = 95.0;
    std::size_t buffer_size = 1000;
  };
  /// All that a resumed run needs.
  struct State {
    std::vector<float> buffer;  ///< [buffer_size], ring
    double threshold = std::numeric_limits<double>::infinity();
    std::size_t pointer = 0, length = 0;
  };

  explicit AdaptiveGradClipper(const Options& options);

  /// @param norm L2 norm over all gradients, before clipping
  /// @return the factor min(1, threshold / (norm + 1e-6)) that the gradients must be multiplied with: 0 for an
  ///         infinite norm, NaN for a NaN
  double update(double norm);

  double threshold() const { return state_.threshold; }
  const State& state() const { return state_; }
  /// @throws InputError when the state was saved with another buffer size
  void restore(const State& state);

 private:
  Options options_;
  State state_;
};

/// The last weights known to be sound, to go back to when an update leaves weights that are not finite
/// (docs/reference/training.md, 2.2). Only the master weights are kept: the models' own are always those, converted.
/// Moments of the optimiser are not kept, as published.
class RecoveryPoint {
 public:
  static constexpr std::int64_t kEvery = 10;  ///< steps from one clone to the next

  /// Keeps a clone before the update of every tenth step, when all of `master` is finite.
  void before_update(std::int64_t step, const torch::Tensor& master);

  /// Puts the clone in the place of weights that are not all finite. @return whether it had to
  /// @throws Error when it had to and there is no clone
  bool after_update(std::int64_t step, torch::Tensor master) const;

  /// True when a run that is saved between two steps needs the clone to go on with the same bits: not when its next
  /// step takes a new one. @param next_step the step that comes after the checkpoint
  bool belongs_to_state(std::int64_t next_step) const { return step_ >= 0 && next_step % kEvery != 0; }

  std::int64_t step() const { return step_; }              ///< of the clone; -1 without one
  const torch::Tensor& master() const { return master_; }  ///< [P] fp32, undefined without a clone
  /// @param master is copied
  void restore(std::int64_t step, const torch::Tensor& master);

 private:
  std::int64_t step_ = -1;
  torch::Tensor master_;
};

struct UpdateOptions {
  AdamW::Options optimizer;
  std::optional<Muon::Options> muon;  ///< set: weight matrices are updated by Muon, the rest by AdamW
  LrSchedule schedule = unscheduled();
  std::variant<std::monostate, double, AdaptiveGradClipper::Options> grad_clip;  ///< none, fixed norm, adaptive
  std::vector<double> ema_rates{0.9999};
  bool ema_warm_up = false;   ///< in step n rates are at most (1 + n) / (10 + n); published: no warm-up
  bool loss_scaling = false;  ///< fp16 on CUDA; fp32 needs none
  double fp16_scale_growth = 1e-3;
};

/// Update of the parameters after the last backward pass of a step: unscale, clip, AdamW, recovery from weights
/// that are not finite, averages, learning rate, loss scale (docs/reference/training.md, 2.2).
class ParameterUpdate {
 public:
  /// @param buffer must outlive this; its values at this moment start the averages
  ParameterUpdate(ParameterBuffer& buffer, const UpdateOptions& options);

  /// Losses must be multiplied with this before backward(): 2^log_scale, or 1 without loss scaling.
  double loss_scale() const;

  struct Result {
    double grad_norm = 0.0;  ///< of the unscaled gradients, before clipping
    double lr = 0.0;         ///< used, or what would have been used, in this step
    bool skipped = false;    ///< gradients not finite; parameters unchanged (log_scale went down)
    bool restored = false;   ///< the update left weights that are not finite; those of recovery.step() are back
  };
  /// @pre buffer.collect_gradients() was called. The averages and the schedule advance also on a skipped update.
  /// @throws Error when weights are not finite and there are none to go back to
  Result apply(std::int64_t step);

  AdamW optimizer;
  std::optional<Muon> muon;
  std::optional<AdaptiveGradClipper> clipper;
  Ema ema;
  RecoveryPoint recovery;
  double log_scale = 15.0;

 private:
  double clip_factor(double norm);

  ParameterBuffer& buffer_;
  UpdateOptions options_;
};

}  // namespace anigen::train
