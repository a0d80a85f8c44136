#include "anigen/flow/flow_matching.h"

#include <vector>

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

}  // namespace anigen::flow
