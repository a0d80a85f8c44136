#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>
#include <tuple>

#include "anigen/nn/state_dict.h"
#include "anigen/vision/dsine_network.h"
#include "tests/nn/largest_difference.h"
#include "tests/vision/deterministic_fill.h"

namespace anigen::vision {
namespace {

using nn::largest_difference;

// TensorFlow's definition, one product at a time. [C, H, W] and [out, in / groups, k, k], fp64.
Tensor slow_same_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias, std::int64_t stride,
                             std::int64_t groups) {
  const std::int64_t height = x.size(1), width = x.size(2), k = weight.size(2);
  const std::int64_t rows = (height + stride - 1) / stride, columns = (width + stride - 1) / stride;
  const std::int64_t top = std::max<std::int64_t>((rows - 1) * stride + k - height, 0) / 2;
  const std::int64_t left = std::max<std::int64_t>((columns - 1) * stride + k - width, 0) / 2;
  const auto in = x.accessor<double, 3>();
  const auto kernel = weight.accessor<double, 4>();
  Tensor result = torch::zeros({weight.size(0), rows, columns}, torch::kFloat64);
  auto out = result.accessor<double, 3>();
  const std::int64_t per_group = weight.size(1), out_per_group = weight.size(0) / groups;
  for (std::int64_t o = 0; o < weight.size(0); ++o) {
    for (std::int64_t i = 0; i < rows; ++i) {
      for (std::int64_t j = 0; j < columns; ++j) {
        double sum = bias[o].item<double>();
        for (std::int64_t c = 0; c < per_group; ++c) {
          for (std::int64_t a = 0; a < k; ++a) {
            for (std::int64_t b = 0; b < k; ++b) {
              const std::int64_t row = i * stride - top + a, column = j * stride - left + b;
              if (row < 0 || row >= height || column < 0 || column >= width) continue;
              sum += kernel[o][c][a][b] * in[o / out_per_group * per_group + c][row][column];
            }
          }
        }
        out[o][i][j] = sum;
      }
    }
  }
  return result;
}

using Case = std::tuple<int, int, int, int, int>;  // kernel, stride, height, width, groups
class SameConvolution : public testing::TestWithParam<Case> {};

TEST_P(SameConvolution, IsTensorFlows) {
  const auto [kernel, stride, height, width, groups] = GetParam();
  torch::manual_seed(1);
  const Tensor x = torch::randn({1, 4, height, width}, torch::kFloat64);
  const Tensor weight = torch::randn({8, 4 / groups, kernel, kernel}, torch::kFloat64);
  const Tensor bias = torch::randn({8}, torch::kFloat64);
  const Tensor wanted = slow_same_convolution(x[0], weight, bias, stride, groups);
  const Tensor found = same_convolution(x, weight, bias, stride, groups);
  ASSERT_EQ(found[0].sizes(), wanted.sizes());
  EXPECT_LT(nn::largest_difference(found[0], wanted), 1e-12);
  // fp32 takes another way through the library.
  const Tensor narrow =
      same_convolution(x.to(torch::kFloat32), weight.to(torch::kFloat32), bias.to(torch::kFloat32), stride, groups);
  EXPECT_LT(nn::largest_difference(narrow[0].to(torch::kFloat64), wanted), 2e-5);
}

INSTANTIATE_TEST_SUITE_P(KernelsAndSizes, SameConvolution,
                         testing::Values(Case{1, 1, 5, 6, 1}, Case{3, 1, 5, 6, 1}, Case{5, 1, 4, 7, 4},
                                         Case{3, 2, 8, 6, 1}, Case{5, 2, 8, 6, 4}, Case{3, 2, 7, 8, 4},
                                         Case{5, 2, 7, 9, 1}, Case{5, 2, 2, 2, 1}, Case{3, 3, 10, 11, 1},
                                         Case{5, 1, 1, 3, 1}));

TEST(EfficientNetB5, ReducesByEightSixteenAndThirtyTwo) {
  const torch::NoGradGuard no_grad;
  EfficientNetB5 encoder;
  for (const Tensor& parameter : encoder->parameters()) parameter.fill_(0.01);
  for (const Tensor& buffer : encoder->buffers()) buffer.fill_(1);
  const EncoderMaps maps = encoder(torch::zeros({1, 3, 64, 96}));
  EXPECT_EQ(maps.eighth.sizes(), torch::IntArrayRef({1, 64, 8, 12}));
  EXPECT_EQ(maps.sixteenth.sizes(), torch::IntArrayRef({1, 176, 4, 6}));
  EXPECT_EQ(maps.thirty_second.sizes(), torch::IntArrayRef({1, 2048, 2, 3}));
}

// Statistics of a layer that has seen something, for a model whose parameters are filled.
void fill_statistics(torch::nn::Module& module) {
  const torch::NoGradGuard no_grad;
  for (const nn::StateEntry& entry : nn::state_entries(module)) {
    if (entry.key.find("running_mean") != std::string::npos) entry.tensor.uniform_(-0.2, 0.2);
    if (entry.key.find("running_var") != std::string::npos) entry.tensor.uniform_(0.5, 1.5);
  }
}

Tensor batch_normed(const Tensor& x, const BatchNormState& norm) {
  return torch::batch_norm(x, norm->weight, norm->bias, norm->running_mean, norm->running_var, /*training=*/false, 0.1,
                           1e-3, /*cudnn_enabled=*/false);
}

TEST(FoldedConvolution, IsTheConvolutionAndTheNormAfterIt) {
  torch::manual_seed(2);
  const torch::NoGradGuard no_grad;
  Conv2d convolution(6, 10, 3, /*with_bias=*/false);
  BatchNormState norm(10);
  for (torch::nn::Module* module :
       {static_cast<torch::nn::Module*>(convolution.get()), static_cast<torch::nn::Module*>(norm.get())}) {
    module->to(torch::kFloat64);
    test::golden_fill(*module);
    fill_statistics(*module);
  }
  const Tensor x = torch::randn({2, 6, 8, 8}, torch::kFloat64);
  const FoldedConvolution folded(convolution, norm);
  const Tensor wanted = batch_normed(convolution(x), norm);
  EXPECT_LT(nn::largest_difference(folded.apply(x), wanted), 1e-12);
  EXPECT_LT(nn::largest_difference(folded.channels(3, 7).apply(x), wanted.slice(1, 3, 7)), 1e-12);
}

TEST(InvertedResidual, IsTheSameInPartsOfItsChannels) {
  // 144 expanded channels of 300 × 300 are handled at once for one picture and in parts for two.
  torch::manual_seed(3);
  const torch::NoGradGuard no_grad;
  InvertedResidualImpl block(24, 40, 3, 2);
  test::golden_fill(block);
  fill_statistics(block);
  const Tensor x = torch::randn({2, 24, 300, 300});
  const Tensor both = block.forward(x);
  ASSERT_EQ(both.sizes(), torch::IntArrayRef({2, 40, 150, 150}));
  for (int i = 0; i < 2; ++i)
    EXPECT_LT(nn::largest_difference(both.slice(0, i, i + 1), block.forward(x.slice(0, i, i + 1))), 1e-5);
}

TEST(InvertedResidual, AddsItsInputWhereTheShapesAgree) {
  const torch::NoGradGuard no_grad;
  InvertedResidualImpl block(8, 8, 3, 1);
  for (const Tensor& parameter : block.parameters()) parameter.zero_();
  for (const Tensor& buffer : block.buffers()) buffer.zero_();
  const Tensor x = torch::randn({1, 8, 6, 6});
  EXPECT_EQ(nn::largest_difference(block.forward(x), x), 0.0);
}

TEST(StandardizedConv2d, IgnoresShiftAndScaleOfAKernel) {
  torch::manual_seed(4);
  const torch::NoGradGuard no_grad;
  StandardizedConv2d layer(3, 5, 3);
  layer->to(torch::kFloat64);
  layer->weight.normal_();
  layer->bias.normal_();
  const Tensor x = torch::randn({1, 3, 6, 6}, torch::kFloat64), before = layer(x);
  const Tensor rows = layer->weight.view({5, -1});
  const Tensor standard = (rows - rows.mean(1, true)) / (rows.std(1, /*unbiased=*/true, /*keepdim=*/true) + 1e-5);
  EXPECT_LT(nn::largest_difference(before, same_convolution(x, standard.view_as(layer->weight), layer->bias)), 1e-12);
  layer->weight.mul_(3.0).add_(7.0);
  EXPECT_LT(nn::largest_difference(layer(x), before),
            1e-3);  // 1e-5 beside the deviation, times the 27 values of a kernel
  EXPECT_GT(before.std().item<double>(), 0.5);
}

TEST(ConvGru, MovesBetweenItsStateAndTheCandidate) {
  torch::manual_seed(5);
  const torch::NoGradGuard no_grad;
  ConvGru gru(4, 3);
  gru->to(torch::kFloat64);
  test::golden_fill(*gru);
  std::map<std::string, Tensor> weights;
  for (const nn::StateEntry& entry : nn::state_entries(*gru)) weights[entry.key] = entry.tensor;
  const Tensor hidden = torch::randn({1, 4, 6, 7}, torch::kFloat64),
               input = torch::randn({1, 3, 6, 7}, torch::kFloat64);
  const auto map = [&](const std::string& name, const Tensor& x) {
    return torch::conv2d(x, weights.at(name + ".weight"), weights.at(name + ".bias"), 1, 2);
  };
  const Tensor both = torch::cat({hidden, input}, 1);
  const Tensor update = map("convz", both).sigmoid(), reset = map("convr", both).sigmoid();
  const Tensor candidate = map("convq", torch::cat({reset * hidden, input}, 1)).tanh();
  EXPECT_LT(nn::largest_difference(gru(hidden, input), (1.0 - update) * hidden + update * candidate), 1e-12);

  weights.at("convz.bias").fill_(-60.0);  // no update
  EXPECT_LT(nn::largest_difference(gru(hidden, input), hidden), 1e-12);
}

}  // namespace
}  // namespace anigen::vision
