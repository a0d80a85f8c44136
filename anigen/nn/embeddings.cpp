#include "anigen/nn/embeddings.h"

#include <cmath>

namespace anigen::nn {

Tensor absolute_position_embedding(const Tensor& coordinates, std::int64_t channels) {
  TORCH_CHECK(coordinates.dim() == 2, "coordinates have the shape [N, axes], not ", coordinates.sizes());
  const std::int64_t axes = coordinates.size(1), count = channels / axes / 2;
  const auto options = coordinates.options().dtype(torch::kFloat32);
  // By the same fp32 operations as the published code.
  const Tensor exponents = torch::arange(count, options) / static_cast<double>(count);
  const Tensor frequencies = torch::pow(10000.0, exponents).reciprocal();
  const Tensor arguments = coordinates.to(torch::kFloat32).unsqueeze(-1) * frequencies;  // [N, axes, F]
  const Tensor waves = torch::cat({arguments.sin(), arguments.cos()}, -1).flatten(1);    // [N, axes · 2F]
  return torch::constant_pad_nd(waves, {0, channels - axes * 2 * count});
}

Tensor grid_coordinates(std::int64_t resolution) {
  const Tensor cells = torch::arange(resolution * resolution * resolution, torch::kInt64);
  const auto axis = [&](std::int64_t stride) { return torch::div(cells, stride, "floor").remainder(resolution); };
  return torch::stack({axis(resolution * resolution), axis(resolution), axis(1)}, 1);
}

namespace {

FourierEmbedding::Options published(std::int64_t num_freqs) {
  FourierEmbedding::Options options;
  options.num_freqs = num_freqs;
  options.max_freq_log2 = static_cast<double>(num_freqs);
  return options;
}

// Formed by the same fp32 operations as the published code: at the largest band one ulp moves the sine by 1e-4.
Tensor make_bands(const FourierEmbedding::Options& options) {
  if (options.log_sampling) return torch::pow(2.0, torch::linspace(0.0, options.max_freq_log2, options.num_freqs));
  return torch::linspace(1.0, std::exp2(options.max_freq_log2), options.num_freqs);
}

// The keys are those of the layers of `mlp`.
struct TimestepMlpImpl : torch::nn::Module {
  TimestepMlpImpl(const Linear& first, const Linear& second) {
    register_module("0", first);
    register_module("2", second);
  }
};

}  // namespace

FourierEmbedding::FourierEmbedding(const Options& options)
    : bands_(make_bands(options)), include_input_(options.include_input) {}

FourierEmbedding::FourierEmbedding(std::int64_t num_freqs) : FourierEmbedding(published(num_freqs)) {}

Tensor FourierEmbedding::operator()(const Tensor& x) const {
  const Tensor bands = bands_.on(x.device()).to(dtype_of(x));
  const Tensor arguments = x.unsqueeze(-2) * bands.unsqueeze(-1);  // [..., n, d]
  // [..., n, 2, d] flattened gives sin(b_0 x), cos(b_0 x), sin(b_1 x), …
  const Tensor waves = torch::stack({arguments.sin(), arguments.cos()}, -2).flatten(-3);
  return include_input_ ? torch::cat({x, waves}, -1) : waves;
}

std::int64_t FourierEmbedding::width(std::int64_t dims) const {
  return dims * (2 * bands().size(0) + (include_input_ ? 1 : 0));
}

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

Tensor joint_count_features(const Tensor& joints_num, std::int64_t most, std::int64_t bands, torch::Dtype dtype) {
  // Arguments are rounded to `grid`; the functions themselves are evaluated in fp32, which fp16 kernels do as well.
  const torch::Dtype grid = dtype == torch::kHalf ? torch::kHalf : torch::promoteTypes(dtype, torch::kFloat32);
  const torch::Dtype wide = torch::promoteTypes(grid, torch::kFloat32);
  const auto rounded = [&](const Tensor& x) { return x.to(grid).to(wide); };
  const auto options = torch::TensorOptions().dtype(wide).device(joints_num.device());
  const Tensor part = rounded((joints_num.to(wide) / static_cast<double>(most)).clamp(0.0, 1.0));
  const Tensor frequencies = rounded(torch::pow(2.0, torch::arange(bands, options)) * M_PI);
  const Tensor arguments = rounded(part.unsqueeze(1) * frequencies);
  return torch::cat({arguments.sin(), arguments.cos()}, 1).to(dtype);
}

JointCountEmbedderImpl::JointCountEmbedderImpl(std::int64_t channels, std::int64_t most, std::int64_t bands)
    : most_(most), bands_(bands) {
  first_ = register_module("0", Linear(2 * bands, channels));
  second_ = register_module("2", Linear(channels, channels));
}

Tensor JointCountEmbedderImpl::forward(const Tensor& joints_num, const Tensor& unconditional) {
  const Tensor features = joint_count_features(joints_num, most_, bands_, dtype_of(first_->weight));
  const Tensor embedding = second_->forward(torch::silu(first_->forward(features)));
  return torch::where((joints_num <= 0).unsqueeze(1), unconditional, embedding);  // dropped counts are 0
}

}  // namespace anigen::nn
