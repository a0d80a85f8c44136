#include "anigen/nn/timestep_embedder.h"

#include <cmath>

namespace anigen::nn {
namespace {

// The keys are those of the layers of `mlp`.
struct TimestepMlpImpl : torch::nn::Module {
  TimestepMlpImpl(const Linear& first, const Linear& second) {
    register_module("0", first);
    register_module("2", second);
  }
};

}  // namespace

Tensor timestep_features(const Tensor& t, std::int64_t width) {
  TORCH_CHECK(t.dim() == 1 && width > 1, "timestep features of width ", width, " for ", t.sizes());
  const std::int64_t half = width / 2;
  // By the same fp32 operations as the published code: at t = 1000 one unit in the last place moves the sine by 1e-4.
  const Tensor steps = torch::arange(half, t.options().dtype(torch::kFloat32));
  const Tensor frequencies = torch::exp(steps * -std::log(10000.0) / static_cast<double>(half));
  const Tensor arguments = t.to(torch::kFloat32).unsqueeze(1) * frequencies;
  const Tensor features = torch::cat({arguments.cos(), arguments.sin()}, 1);
  return width % 2 == 0 ? features : torch::constant_pad_nd(features, {0, 1});
}

TimestepEmbedderImpl::TimestepEmbedderImpl(std::int64_t channels, std::int64_t frequency_channels)
    : frequency_channels_(frequency_channels) {
  first = Linear(frequency_channels, channels);
  second = Linear(channels, channels);
  register_module("mlp", std::make_shared<TimestepMlpImpl>(first, second));
}

Tensor TimestepEmbedderImpl::forward(const Tensor& t) {
  const Tensor features = timestep_features(t, frequency_channels_).to(dtype_of(first->weight));
  return second->forward(torch::silu(first->forward(features)));
}

}  // namespace anigen::nn
