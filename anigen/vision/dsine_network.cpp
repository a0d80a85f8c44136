#include "anigen/vision/dsine_network.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/vision/dsine.h"

namespace anigen::vision {

namespace {

// Padding of one axis: by as much at both ends as the library wants it, and how many outputs to drop in front.
struct AxisPadding {
  std::int64_t both_ends, drop, outputs;
};

AxisPadding same_padding(std::int64_t size, std::int64_t kernel, std::int64_t stride) {
  const std::int64_t outputs = (size + stride - 1) / stride;
  const std::int64_t zeros = std::max<std::int64_t>((outputs - 1) * stride + kernel - size, 0);
  const std::int64_t before = zeros / 2;
  if (zeros % 2 == 0) return {before, 0, outputs};
  // One zero more behind: a whole stride more at both ends, and the one output that it adds in front dropped. A padded
  // copy of the input would be the largest tensor of the network.
  return {before + stride, 1, outputs};
}

constexpr std::int64_t kExpansion = 6;
// Values of an expanded tensor that are held at once, and the fewest channels: the network's largest tensors stand
// here, and what happens to them happens to every channel for itself.
constexpr std::int64_t kExpandedValues = std::int64_t{1} << 24, kFewestChannels = 16;

std::int64_t channels_at_once(const Tensor& x, std::int64_t channels) {
  const std::int64_t fitting = kExpandedValues / (x.size(0) * x.size(2) * x.size(3));
  return std::min(std::max(fitting / kFewestChannels * kFewestChannels, kFewestChannels), channels);
}

Tensor with_skip(Tensor y, const Tensor& x) { return y.sizes() == x.sizes() ? y.add_(x) : y; }

struct StageShape {
  std::int64_t blocks, kernel, stride, out;  // the stride is the first block's
};
// Width and depth of B0 times 1.6 and 2.2, rounded (Tan and Le 2019, "EfficientNet", equation 3).
constexpr std::array<StageShape, 7> kB5Stages = {
    {{3, 3, 1, 24}, {5, 3, 2, 40}, {5, 5, 2, 64}, {7, 3, 2, 128}, {7, 5, 1, 176}, {9, 5, 2, 304}, {3, 3, 1, 512}}};
constexpr std::int64_t kStemChannels = 48, kStemStride = 2, kHeadChannels = 2048;
constexpr std::size_t kEighthStage = 2, kSixteenthStage = 4;

// Depthwise k × k, squeeze and excite, 1 × 1. Keys `conv_dw`, `bn1`, `se`, `conv_pw`, `bn2`.
class DepthwiseSeparableImpl : public EfficientNetBlockImpl {
 public:
  DepthwiseSeparableImpl(std::int64_t in, std::int64_t out, std::int64_t kernel) {
    conv_dw_ = register_module("conv_dw", Conv2d(in, in, kernel, /*with_bias=*/false, /*groups=*/in));
    bn1_ = register_module("bn1", BatchNormState(in));
    se_ = register_module("se", SqueezeExcite(in, in));
    conv_pw_ = register_module("conv_pw", Conv2d(in, out, 1, /*with_bias=*/false));
    bn2_ = register_module("bn2", BatchNormState(out));
  }

  Tensor forward(const Tensor& x) override {
    Tensor y = FoldedConvolution(conv_dw_, bn1_).apply(x, /*stride=*/1, /*groups=*/x.size(1));
    y = se_(torch::silu_(y));
    return with_skip(FoldedConvolution(conv_pw_, bn2_).apply(y), x);
  }

 private:
  Conv2d conv_dw_ = nullptr, conv_pw_ = nullptr;
  BatchNormState bn1_ = nullptr, bn2_ = nullptr;
  SqueezeExcite se_ = nullptr;
};

std::shared_ptr<EfficientNetBlockImpl> make_block(std::size_t stage, std::int64_t in, std::int64_t stride) {
  const StageShape& shape = kB5Stages[stage];
  if (stage == 0) return std::make_shared<DepthwiseSeparableImpl>(in, shape.out, shape.kernel);
  return std::make_shared<InvertedResidualImpl>(in, shape.out, shape.kernel, stride);
}

constexpr std::int64_t kRayChannels = 2, kHeadWidth = 128, kStateWidth = 64;

torch::nn::GroupNorm group_norm_of_8(std::int64_t channels) {
  return torch::nn::GroupNorm(torch::nn::GroupNormOptions(8, channels).eps(1e-5));
}

Tensor with_rays(const Tensor& map, const Tensor& slopes) {
  return torch::cat({map, slopes.expand({map.size(0), -1, -1, -1})}, 1);
}

Tensor leaky(Tensor x) { return torch::leaky_relu_(x, 0.01); }

}  // namespace

Conv2dImpl::Conv2dImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel, bool with_bias,
                       std::int64_t groups)
    : groups_(groups) {
  weight = register_parameter("weight", torch::empty({out_channels, in_channels / groups, kernel, kernel}));
  if (with_bias) bias = register_parameter("bias", torch::empty({out_channels}));
}

Tensor Conv2dImpl::forward(const Tensor& x) { return same_convolution(x, weight, bias, /*stride=*/1, groups_); }

Tensor same_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias, std::int64_t stride,
                        std::int64_t groups) {
  const AxisPadding rows = same_padding(x.size(2), weight.size(2), stride);
  const AxisPadding columns = same_padding(x.size(3), weight.size(3), stride);
  const Tensor all = at::conv2d(x, weight, bias, {stride, stride}, {rows.both_ends, columns.both_ends},
                                /*dilation=*/at::IntArrayRef{1, 1}, groups);
  return all.narrow(2, rows.drop, rows.outputs).narrow(3, columns.drop, columns.outputs);
}

BatchNormStateImpl::BatchNormStateImpl(std::int64_t channels) {
  weight = register_parameter("weight", torch::empty({channels}));
  bias = register_parameter("bias", torch::empty({channels}));
  running_mean = register_buffer("running_mean", torch::empty({channels}));
  running_var = register_buffer("running_var", torch::empty({channels}));
  num_batches_tracked = register_buffer("num_batches_tracked", torch::zeros({}, torch::kInt64));
}

FoldedConvolution::FoldedConvolution(const Conv2d& convolution, const BatchNormState& norm) {
  constexpr double kEps = 1e-3;
  const Tensor scale = norm->weight / (norm->running_var + kEps).sqrt();
  weight = convolution->weight * scale.view({-1, 1, 1, 1});
  bias = norm->bias - norm->running_mean * scale;
}

FoldedConvolution FoldedConvolution::channels(std::int64_t begin, std::int64_t end) const {
  FoldedConvolution part;
  part.weight = weight.slice(0, begin, end);
  part.bias = bias.slice(0, begin, end);
  return part;
}

Tensor FoldedConvolution::apply(const Tensor& x, std::int64_t stride, std::int64_t groups) const {
  return same_convolution(x, weight, bias, stride, groups);
}

SqueezeExciteImpl::SqueezeExciteImpl(std::int64_t channels, std::int64_t block_inputs) {
  const std::int64_t narrow = std::max<std::int64_t>((block_inputs + 2) / 4, 1);  // a quarter, rounded
  conv_reduce_ = register_module("conv_reduce", Conv2d(channels, narrow, 1));
  conv_expand_ = register_module("conv_expand", Conv2d(narrow, channels, 1));
}

Tensor SqueezeExciteImpl::forward(Tensor x) {
  const Tensor mean = x.mean({2, 3}, /*keepdim=*/true);
  return x.mul_(torch::sigmoid(conv_expand_(torch::silu(conv_reduce_(mean)))));
}

InvertedResidualImpl::InvertedResidualImpl(std::int64_t in, std::int64_t out, std::int64_t kernel, std::int64_t stride)
    : stride_(stride) {
  const std::int64_t wide = kExpansion * in;
  conv_pw_ = register_module("conv_pw", Conv2d(in, wide, 1, /*with_bias=*/false));
  bn1_ = register_module("bn1", BatchNormState(wide));
  conv_dw_ = register_module("conv_dw", Conv2d(wide, wide, kernel, /*with_bias=*/false, /*groups=*/wide));
  bn2_ = register_module("bn2", BatchNormState(wide));
  se_ = register_module("se", SqueezeExcite(wide, in));
  conv_pwl_ = register_module("conv_pwl", Conv2d(wide, out, 1, /*with_bias=*/false));
  bn3_ = register_module("bn3", BatchNormState(out));
}

Tensor InvertedResidualImpl::expanded(const Tensor& x) const {
  const FoldedConvolution expand(conv_pw_, bn1_), filter(conv_dw_, bn2_);
  const std::int64_t channels = expand.bias.size(0), step = channels_at_once(x, channels);
  Tensor all;
  for (std::int64_t begin = 0; begin < channels; begin += step) {
    const std::int64_t end = std::min(begin + step, channels);
    Tensor part = expand.channels(begin, end).apply(x);
    part = filter.channels(begin, end).apply(torch::silu_(part), stride_, /*groups=*/end - begin);
    torch::silu_(part);
    if (step >= channels) return part;
    if (!all.defined()) all = torch::empty({x.size(0), channels, part.size(2), part.size(3)}, part.options());
    all.slice(1, begin, end).copy_(part);
  }
  return all;
}

Tensor InvertedResidualImpl::forward(const Tensor& x) {
  return with_skip(FoldedConvolution(conv_pwl_, bn3_).apply(se_(expanded(x))), x);
}

EfficientNetB5Impl::EfficientNetB5Impl() {
  conv_stem_ = register_module("conv_stem", Conv2d(3, kStemChannels, 3, /*with_bias=*/false));
  bn1_ = register_module("bn1", BatchNormState(kStemChannels));
  torch::nn::ModuleList stages = register_module("blocks", torch::nn::ModuleList());
  std::int64_t channels = kStemChannels;
  for (std::size_t s = 0; s < kB5Stages.size(); ++s) {
    torch::nn::ModuleList blocks;
    stages_.emplace_back();
    for (std::int64_t b = 0; b < kB5Stages[s].blocks; ++b) {
      stages_.back().push_back(make_block(s, channels, b == 0 ? kB5Stages[s].stride : 1));
      blocks->push_back(std::shared_ptr<torch::nn::Module>(stages_.back().back()));
      channels = kB5Stages[s].out;
    }
    stages->push_back(blocks);
  }
  conv_head_ = register_module("conv_head", Conv2d(channels, kHeadChannels, 1, /*with_bias=*/false));
  bn2_ = register_module("bn2", BatchNormState(kHeadChannels));
}

EncoderMaps EfficientNetB5Impl::forward(const Tensor& images) {
  EncoderMaps maps;
  Tensor x = FoldedConvolution(conv_stem_, bn1_).apply(images, kStemStride);
  torch::silu_(x);
  for (std::size_t s = 0; s < stages_.size(); ++s) {
    for (const auto& block : stages_[s]) x = block->forward(x);
    if (s == kEighthStage) maps.eighth = x;
    if (s == kSixteenthStage) maps.sixteenth = x;
  }
  maps.thirty_second = conv_head_(x);
  return maps;
}

ConvGruImpl::ConvGruImpl(std::int64_t hidden_channels, std::int64_t input_channels) {
  constexpr std::int64_t kKernel = 5;
  const std::int64_t all = hidden_channels + input_channels;
  convz_ = register_module("convz", Conv2d(all, hidden_channels, kKernel));
  convr_ = register_module("convr", Conv2d(all, hidden_channels, kKernel));
  convq_ = register_module("convq", Conv2d(all, hidden_channels, kKernel));
}

Tensor ConvGruImpl::forward(const Tensor& hidden, const Tensor& input) {
  const Tensor both = torch::cat({hidden, input}, 1);
  const Tensor update = torch::sigmoid(convz_(both)), reset = torch::sigmoid(convr_(both));
  const Tensor candidate = torch::tanh(convq_(torch::cat({reset * hidden, input}, 1)));
  return torch::lerp(hidden, candidate, update);
}

Tensor convex_upsampling(const Tensor& x, const Tensor& mask) {
  constexpr std::int64_t kFactor = 8, kNeighbors = 9;
  const std::int64_t batch = x.size(0), channels = x.size(1), height = x.size(2), width = x.size(3);
  const Tensor shares = mask.view({batch, kNeighbors, kFactor, kFactor, height, width}).softmax(1);
  const Tensor around = neighborhood(x, 1);
  Tensor fine = torch::zeros({batch, channels, kFactor, kFactor, height, width}, x.options());
  for (std::int64_t q = 0; q < kNeighbors; ++q) {
    const Tensor value = around.select(2, q).view({batch, channels, 1, 1, height, width});
    fine.addcmul_(shares.select(1, q).unsqueeze(1), value);
  }
  return fine.permute({0, 1, 4, 2, 5, 3}).reshape({batch, channels, height * kFactor, width * kFactor});
}

PredictionHeadImpl::PredictionHeadImpl(std::int64_t in, std::int64_t hidden, std::int64_t out) {
  spatial_ = register_module("0", Conv2d(in, hidden, 3));
  hidden_ = register_module("2", Conv2d(hidden, hidden, 1));
  out_ = register_module("4", Conv2d(hidden, out, 1));
}

Tensor PredictionHeadImpl::forward(const Tensor& x) {
  Tensor y = spatial_(x);
  y = hidden_(torch::relu_(y));
  return out_(torch::relu_(y));
}

Tensor StandardizedConv2dImpl::forward(const Tensor& x) {
  const Tensor rows = weight.flatten(1);
  Tensor standardized = rows - rows.mean(1, /*keepdim=*/true);
  // The library's own deviation is several times slower than a norm.
  const double root = std::sqrt(static_cast<double>(rows.size(1) - 1));
  standardized.div_(standardized.norm(2, {1}, /*keepdim=*/true) / root + 1e-5);
  return same_convolution(x, standardized.view_as(weight), bias);
}

UpStageImpl::UpStageImpl(std::int64_t in, std::int64_t out) {
  const auto net = register_module("_net", std::make_shared<torch::nn::Module>());
  first_ = net->register_module("0", StandardizedConv2d(in, out, 3));
  first_norm_ = net->register_module("1", group_norm_of_8(out));
  second_ = net->register_module("3", StandardizedConv2d(out, out, 3));
  second_norm_ = net->register_module("4", group_norm_of_8(out));
}

Tensor UpStageImpl::forward(const Tensor& x, const Tensor& skip) {
  // One tensor after another, so that none of these wide ones outlives its use.
  Tensor y = at::upsample_bilinear2d(x, {skip.size(2), skip.size(3)}, /*align_corners=*/false);
  y = torch::cat({y, skip}, 1);
  y = first_(y);
  y = leaky(first_norm_(y));
  y = second_(y);
  return leaky(second_norm_(y));
}

NormalDecoderImpl::NormalDecoderImpl() {
  constexpr std::int64_t kBottom = 2048, kMiddle = 1024, kTop = 512, kSkip16 = 176, kSkip8 = 64;
  conv2_ = register_module("conv2", Conv2d(kBottom + kRayChannels, kBottom, 1));
  up1_ = register_module("up1", UpStage(kBottom + kSkip16 + kRayChannels, kMiddle));
  up2_ = register_module("up2", UpStage(kMiddle + kSkip8 + kRayChannels, kTop));
  normal_head_ = register_module("normal_head", PredictionHead(kTop + kRayChannels, kHeadWidth, 3));
  feature_head_ = register_module("feature_head", PredictionHead(kTop + kRayChannels, kHeadWidth, kStateWidth));
  hidden_head_ = register_module("hidden_head", PredictionHead(kTop + kRayChannels, kHeadWidth, kStateWidth));
}

DecoderMaps NormalDecoderImpl::forward(const EncoderMaps& maps, const RaySlopes& rays) {
  Tensor x = conv2_(with_rays(maps.thirty_second, rays.thirty_second));
  x = up1_(x, with_rays(maps.sixteenth, rays.sixteenth));
  x = with_rays(up2_(x, with_rays(maps.eighth, rays.eighth)), rays.eighth);
  return {unit_vectors(normal_head_(x)), feature_head_(x), hidden_head_(x)};
}

}  // namespace anigen::vision
