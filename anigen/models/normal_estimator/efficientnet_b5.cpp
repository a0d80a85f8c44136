#include "anigen/models/normal_estimator/efficientnet_b5.h"

#include <array>

namespace anigen::models {
namespace {

struct StageShape {
  std::int64_t blocks, kernel, stride, out;  // the stride is the first block's
};
// Width and depth of B0 times 1.6 and 2.2, rounded (Tan and Le 2019, "EfficientNet", equation 3).
constexpr std::array<StageShape, 7> kB5Stages = {
    {{3, 3, 1, 24}, {5, 3, 2, 40}, {5, 5, 2, 64}, {7, 3, 2, 128}, {7, 5, 1, 176}, {9, 5, 2, 304}, {3, 3, 1, 512}}};
constexpr std::int64_t kStemChannels = 48, kStemStride = 2, kHeadChannels = 2048;
constexpr std::size_t kEighthStage = 2, kSixteenthStage = 4;

std::shared_ptr<EfficientNetBlockImpl> make_block(std::size_t stage, std::int64_t in, std::int64_t stride) {
  const StageShape& shape = kB5Stages[stage];
  if (stage == 0) return std::make_shared<DepthwiseSeparableImpl>(in, shape.out, shape.kernel);
  return std::make_shared<InvertedResidualImpl>(in, shape.out, shape.kernel, stride);
}

}  // namespace

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

}  // namespace anigen::models
