#include "anigen/flow/matching.h"

#include <cmath>
#include <vector>

#include "anigen/core/config.h"

namespace anigen::flow {

namespace {

// [B] → [B, 1, 1, …], to multiply a tensor with B entries along its first axis.
Tensor over_items(const Tensor& t, const Tensor& x) {
  TORCH_CHECK(t.dim() == 1 && t.size(0) == x.size(0), "a flow takes one time per entry: ", x.size(0),
              " entries, times ", t.sizes());
  std::vector<std::int64_t> shape(static_cast<std::size_t>(x.dim()), 1);
  shape[0] = t.size(0);
  return t.to(x.options()).view(shape);
}

}  // namespace

Tensor noisy(const Tensor& x_0, const Tensor& noise, const Tensor& t, double sigma_min) {
  const Tensor time = over_items(t, x_0);
  return (1.0 - time) * x_0 + (sigma_min + (1.0 - sigma_min) * time) * noise;
}

Tensor velocity_target(const Tensor& x_0, const Tensor& noise, double sigma_min) {
  return (1.0 - sigma_min) * noise - x_0;
}

Tensor x0_from_velocity(const Tensor& x_t, const Tensor& velocity, const Tensor& t, double sigma_min) {
  const Tensor time = over_items(t, x_t);
  return (1.0 - sigma_min) * x_t - (sigma_min + (1.0 - sigma_min) * time) * velocity;
}

Tensor noise_from_velocity(const Tensor& x_t, const Tensor& velocity, const Tensor& t) {
  return (1.0 - over_items(t, x_t)) * velocity + x_t;
}

Tensor noisy(const Tensor& x_0, const Tensor& noise, double t, double sigma_min) {
  return (1.0 - t) * x_0 + (sigma_min + (1.0 - sigma_min) * t) * noise;
}

Tensor x0_from_velocity(const Tensor& x_t, const Tensor& velocity, double t, double sigma_min) {
  return (1.0 - sigma_min) * x_t - (sigma_min + (1.0 - sigma_min) * t) * velocity;
}

Tensor model_time(const Tensor& t) { return (t * kTimeScale).to(torch::kFloat32); }

Tensor time_bin(const Tensor& t, std::int64_t bins) {
  const Tensor edges = torch::linspace(0.0, 1.0, bins + 1, torch::kFloat64);
  const Tensor times = t.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  return torch::bucketize(times, edges, /*out_int32=*/false, /*right=*/true) - 1;
}

Tensor mean_per_time_bin(const Tensor& values, const Tensor& t, std::int64_t bins) {
  // Members of every bin as the host knows them, which then need not wait for the values; 0 / 0 without any.
  const Tensor members = time_bin(t, bins).unsqueeze(0) == torch::arange(bins, torch::kInt64).unsqueeze(1);
  const Tensor counts = members.sum(1).to(torch::kFloat64);
  const Tensor list = values.detach().to(torch::kFloat64).unsqueeze(0), inside = nn::to_device(members, list.device());
  return torch::where(inside, list, torch::zeros_like(list)).sum(1) / nn::to_device(counts, list.device());
}

Tensor mse_per_item(const Tensor& prediction, const Tensor& target) {
  const torch::Dtype wide = nn::accumulation_dtype(nn::dtype_of(prediction));
  return (prediction.to(wide) - target.to(wide)).square().flatten(1).mean(1);
}

Tensor mean_per_item(const Tensor& rows, const Tensor& item, std::int64_t items) {
  const Tensor sums = torch::zeros({items}, rows.options()).index_add(0, item, rows.mean(1));
  // Not bincount, for whose largest value the host would wait.
  const Tensor counts =
      torch::zeros({items}, rows.options()).index_add(0, item, torch::ones_like(item, rows.options()));
  return sums / counts.clamp_min(1.0);
}

void TimeSchedule::fields(ConfigFields& f) {
  f("name", kind, {{"uniform", Kind::kUniform}, {"logitNormal", Kind::kLogitNormal}});
  if (kind == Kind::kUniform && f.writes()) return;
  f.object("args", [this](ConfigFields& args) {
    if (kind == Kind::kUniform) return;
    args("mean", mean);
    args("std", deviation);
    if (deviation <= 0.0) throw args.error("std", "must be positive");
  });
}

Tensor TimeSchedule::sample(std::int64_t count, const at::Generator& generator) const {
  return from_draws(kind == Kind::kUniform ? torch::rand({count}, generator) : torch::randn({count}, generator));
}

Tensor TimeSchedule::from_draws(const Tensor& draws) const {
  return kind == Kind::kUniform ? draws : torch::sigmoid(draws * deviation + mean);
}

Tensor TimeSchedule::quantiles(const Tensor& probabilities) const {
  // Φ⁻¹(p) = √2 erf⁻¹(2p − 1)
  return from_draws(kind == Kind::kUniform ? probabilities : std::sqrt(2.0) * (2.0 * probabilities - 1.0).erfinv());
}

Tensor draw_condition_dropout(std::int64_t count, double probability, const at::Generator& generator) {
  // In double, so that probability 1 drops every item and 0 none.
  return torch::rand({count}, generator, torch::kFloat64) < probability;
}

Tensor replace_condition(const Tensor& condition, const Tensor& dropped, const Tensor& negative) {
  TORCH_CHECK(dropped.dim() == 1 && dropped.size(0) == condition.size(0), "condition dropout of ", condition.size(0),
              " items with a mask of shape ", dropped.sizes());
  std::vector<std::int64_t> shape(static_cast<std::size_t>(condition.dim()), 1);
  shape[0] = dropped.size(0);
  const Tensor mask = nn::to_device(dropped, condition.device()).to(torch::kBool).view(shape);
  return torch::where(mask, negative.defined() ? negative : torch::zeros_like(condition), condition);
}

}  // namespace anigen::flow
