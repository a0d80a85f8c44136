#pragma once
#include <cstdint>
#include <string>

#include "anigen/core/config_fields.h"
#include "anigen/nn/torch.h"

namespace anigen::flow {

using torch::Tensor;

/// Straight paths between data x₀ (t = 0) and noise ε (t = 1); docs/reference/flows.md, 4.1. All functions take one
/// time per entry of the first axis: [B] for dense latents [B, C, X, Y, Z]; for features [N, C] of a sparse tensor the
/// time of each voxel's batch item, [N].
inline constexpr double kSigmaMin = 1e-5;     ///< what is left of the noise at t = 0
inline constexpr double kTimeScale = 1000.0;  ///< models are given 1000 t

/// x_t = (1 − t) x₀ + (σ + (1 − σ) t) ε
Tensor noisy(const Tensor& x_0, const Tensor& noise, const Tensor& t, double sigma_min = kSigmaMin);
/// v = (1 − σ) ε − x₀ = ∂x_t/∂t: points from data to noise.
Tensor velocity_target(const Tensor& x_0, const Tensor& noise, double sigma_min = kSigmaMin);
/// x₀ = (1 − σ) x_t − (σ + (1 − σ) t) v
Tensor x0_from_velocity(const Tensor& x_t, const Tensor& velocity, const Tensor& t, double sigma_min = kSigmaMin);
/// ε = (1 − t) v + x_t
Tensor noise_from_velocity(const Tensor& x_t, const Tensor& velocity, const Tensor& t);

/// Overload for one time that all entries share, as in a sampler.
Tensor noisy(const Tensor& x_0, const Tensor& noise, double t, double sigma_min = kSigmaMin);
Tensor x0_from_velocity(const Tensor& x_t, const Tensor& velocity, double t, double sigma_min = kSigmaMin);

/// 1000 t, fp32.
Tensor model_time(const Tensor& t);

inline constexpr std::int64_t kTimeBins = 10;

/// Index of the part, of `bins` equal parts of [0, 1], that each time lies in; a part holds its lower end. t = 1 gives
/// `bins`.
/// @return [B] int64
Tensor time_bin(const Tensor& t, std::int64_t bins = kTimeBins);

/// Mean of the values whose time lies in each bin, for the training log: a loss that is low at noisy times and high
/// at clean ones shows here and not in the total. @param values [B] @param t [B]; read by the host, which does not wait
/// for the values @return [bins] fp64 on the device of the values, NaN where no time falls
Tensor mean_per_time_bin(const Tensor& values, const Tensor& t, std::int64_t bins = kTimeBins);

/// Mean squared error of each item. @param prediction, target [B, ...] @return [B] in fp32 or wider
Tensor mse_per_item(const Tensor& prediction, const Tensor& target);

/// Mean of each item over its rows and their channels, where rows of several items lie below each other.
/// @param rows [N, C] @param item [N] int64 @return [items]; 0 for an item without rows
Tensor mean_per_item(const Tensor& rows, const Tensor& item, std::int64_t items);

/// Distribution of the flow time t of each batch item, shared by all streams of the item: 1 is noise, 0 is data
/// (docs/reference/flows.md, 4.1). Config object `t_schedule`: {"name": "uniform"} or {"name": "logitNormal", "args":
/// {"mean": 1.0, "std": 1.0}}.
struct TimeSchedule : JsonOptions<TimeSchedule> {
  enum class Kind {
    kUniform,     ///< t ~ U[0, 1)
    kLogitNormal  ///< t = sigmoid(mean + deviation · z), z ~ N(0, 1)
  };
  Kind kind = Kind::kLogitNormal;
  double mean = 0.0;  ///< default of the class; the published configs say 1
  double deviation = 1.0;

  void fields(ConfigFields& f);  ///< @throws InputError for a standard deviation that is not positive

  /// @return [count] fp32 on the CPU, drawn from this generator alone
  Tensor sample(std::int64_t count, const at::Generator& generator) const;
  /// The times that belong to given draws: standard normal ones for logitNormal, uniform ones for uniform.
  Tensor from_draws(const Tensor& draws) const;
  /// The times that training draws earlier than with these probabilities. @param probabilities in (0, 1)
  Tensor quantiles(const Tensor& probabilities) const;
};

/// Classifier-free guidance needs a model that also knows the absence of a condition: in training each item's
/// condition is replaced by the negative one with probability p_uncond (docs/reference/flows.md, 4.2).
/// @param probability in [0, 1]
/// @return [count] bool on the CPU, drawn from this generator alone: which items lose their condition
Tensor draw_condition_dropout(std::int64_t count, double probability, const at::Generator& generator);

/// @param condition [B, ...] @param dropped [B] bool @param negative like condition; undefined: zeros, the negative of
/// image conditions @return the condition with the dropped items replaced
Tensor replace_condition(const Tensor& condition, const Tensor& dropped, const Tensor& negative = {});

}  // namespace anigen::flow
