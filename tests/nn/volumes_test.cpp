#include "anigen/nn/volumes.h"

#include <ATen/Parallel.h>
#include <gtest/gtest.h>

#include <ostream>
#include <vector>

#include "anigen/nn/kernels/mixed_products.h"
#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/kernels/volume_convolution.h"
#include "tests/support/kernel_forms.h"

namespace anigen::nn::kernels {

// Text of a parameter for GoogleTest.
void PrintTo(const VolumeConvolutionSizes& s, std::ostream* out) {
  *out << s.batch << " x " << s.x << " " << s.y << " " << s.z << ", " << s.in << " to " << s.out << " channels";
}

}  // namespace anigen::nn::kernels

namespace anigen::nn {
namespace {

using kernels::VolumeConvolutionSizes;

constexpr auto kChannelsLast = torch::MemoryFormat::ChannelsLast3d;

// Largest difference as a share of one plus the largest wanted value.
double volume_difference(const Tensor& found, const Tensor& wanted) {
  const Tensor exact = wanted.to(torch::kFloat64);
  return ((found.to(torch::kFloat64) - exact).abs().max() / (1.0 + exact.abs().max())).item<double>();
}

// Values of a few units, fp64: a volume, the layer's parameters, and a direction for the gradient.
struct VolumeCase {
  VolumeCase(const VolumeConvolutionSizes& s, std::int64_t kernel, std::int64_t edge_divisor) {
    torch::manual_seed(21);
    const std::int64_t k = kernel, d = edge_divisor;
    x = torch::randn({s.batch, s.in, s.x, s.y, s.z}, torch::kFloat64);
    weight = torch::randn({s.out, s.in, k, k, k}, torch::kFloat64);
    bias = torch::randn({s.out}, torch::kFloat64);
    direction = torch::randn({s.batch, s.out, s.x / d, s.y / d, s.z / d}, torch::kFloat64);
  }
  explicit VolumeCase(const VolumeConvolutionSizes& s) : VolumeCase(s, 3, 1) {}

  // Output and the gradients of volume, weight and bias.
  template <typename Convolution>
  std::vector<Tensor> run(const Convolution& convolution, torch::Dtype dtype,
                          torch::MemoryFormat format = torch::MemoryFormat::Contiguous) const {
    const Tensor volume = x.to(dtype).contiguous(format);
    std::vector<Tensor> inputs{volume, weight.to(dtype), bias.to(dtype)};
    for (Tensor& input : inputs) input = input.detach().requires_grad_();
    const Tensor out = convolution(inputs[0], inputs[1], inputs[2]);
    std::vector<Tensor> results = torch::autograd::grad({out}, inputs, {direction.to(dtype)});
    results.insert(results.begin(), out.detach());
    return results;
  }
  Tensor x, weight, bias, direction;
};

Tensor library_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  return torch::conv3d(x, weight, bias, {1, 1, 1}, {1, 1, 1});
}

Tensor library_patch_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  const std::int64_t k = weight.size(2);
  return torch::conv3d(x, weight, bias, {k, k, k}, {0, 0, 0});
}

void expect_same_results(const std::vector<Tensor>& found, const std::vector<Tensor>& wanted) {
  const char* names[] = {"output", "gradient of the volume", "gradient of the weight", "gradient of the bias"};
  for (std::size_t i = 0; i < 4; ++i) {
    ASSERT_EQ(found[i].sizes(), wanted[i].sizes()) << names[i];
    // fp32 sums of up to some thousand products of size one: a few times 1e-6 of the largest value.
    EXPECT_LT(volume_difference(found[i], wanted[i]), 1e-5) << names[i];
  }
}

class VolumeConvolutionShapes : public testing::TestWithParam<VolumeConvolutionSizes> {};

TEST_P(VolumeConvolutionShapes, AgreesWithTheLibraryInDouble) {
  const VolumeCase c(GetParam());
  const std::vector<Tensor> wanted = c.run(library_convolution, torch::kFloat64);
  test::in_every_kernel_form([&] {
    for (const auto format : {torch::MemoryFormat::Contiguous, kChannelsLast}) {
      const std::vector<Tensor> found = c.run(volume_convolution, torch::kFloat32, format);
      EXPECT_TRUE(found[0].is_contiguous(kChannelsLast));
      expect_same_results(found, wanted);
    }
  });
}

// Batch, edges, channels in and out: one of everything; one channel; lines that fill tiles of 12 or 6 voxels exactly,
// nearly and not; channels that fill vectors of 8 and blocks of 16, and not; groups of several lines.
INSTANTIATE_TEST_SUITE_P(
    Sizes, VolumeConvolutionShapes,
    testing::Values(VolumeConvolutionSizes{1, 1, 1, 1, 1, 1}, VolumeConvolutionSizes{2, 3, 4, 5, 1, 8},
                    VolumeConvolutionSizes{2, 4, 3, 13, 8, 1}, VolumeConvolutionSizes{1, 5, 2, 7, 3, 3},
                    VolumeConvolutionSizes{2, 2, 6, 16, 9, 24}, VolumeConvolutionSizes{1, 6, 7, 25, 17, 37},
                    VolumeConvolutionSizes{3, 1, 2, 3, 16, 16}, VolumeConvolutionSizes{1, 40, 9, 12, 8, 8},
                    VolumeConvolutionSizes{1, 4, 33, 24, 8, 8}));

KERNEL_TEST(VolumeConvolution, AnyStridesGiveTheSame) {
  const VolumeCase c({2, 4, 5, 6, 3, 8});
  const Tensor x = c.x.to(torch::kFloat32), weight = c.weight.to(torch::kFloat32), bias = c.bias.to(torch::kFloat32);
  const Tensor wanted = volume_convolution(x, weight, bias);
  const Tensor other_order = x.permute({4, 2, 0, 1, 3}).contiguous().permute({2, 3, 1, 4, 0});
  ASSERT_TRUE(torch::equal(other_order, x));
  EXPECT_TRUE(torch::equal(volume_convolution(other_order, weight, bias), wanted));
  const Tensor mirrored_order = weight.permute({4, 3, 2, 1, 0}).contiguous().permute({4, 3, 2, 1, 0});
  EXPECT_TRUE(torch::equal(volume_convolution(x, mirrored_order, bias), wanted));
  // A gradient without memory of its own, as sum() gives.
  const Tensor leaf = x.detach().requires_grad_();
  const Tensor slope = torch::autograd::grad({volume_convolution(leaf, weight, bias).sum()}, {leaf})[0];
  const Tensor dense =
      torch::autograd::grad({volume_convolution(leaf, weight, bias)}, {leaf}, {torch::ones_like(wanted)})[0];
  EXPECT_TRUE(torch::equal(slope, dense));
}

KERNEL_TEST(VolumeConvolution, TheNumberOfThreadsChangesNoBit) {
  const int before = at::get_num_threads();
  for (const VolumeConvolutionSizes& sizes :
       {VolumeConvolutionSizes{2, 7, 5, 9, 5, 20}, VolumeConvolutionSizes{1, 40, 3, 8, 8, 8}}) {
    const VolumeCase c(sizes);
    at::set_num_threads(1);
    const std::vector<Tensor> one = c.run(volume_convolution, torch::kFloat32);
    for (const int threads : {2, 3}) {
      at::set_num_threads(threads);
      const std::vector<Tensor> more = c.run(volume_convolution, torch::kFloat32);
      for (std::size_t i = 0; i < 4; ++i) EXPECT_TRUE(torch::equal(one[i], more[i])) << i << ", " << threads;
    }
  }
  at::set_num_threads(before);
}

class MixedVolumeConvolutionShapes : public testing::TestWithParam<VolumeConvolutionSizes> {};

// Factors are rounded and nothing else is: all results are those of rounded volumes, weights and slopes, but for the
// gradient of the bias, which has no factors.
TEST_P(MixedVolumeConvolutionShapes, AgreesWithTheLibraryOnRoundedFactors) {
  const VolumeCase c(GetParam());
  VolumeCase rounded = c;
  for (Tensor* x : {&rounded.x, &rounded.weight, &rounded.direction})
    *x = x->to(torch::kFloat32).to(torch::kBFloat16).to(torch::kFloat64);
  std::vector<Tensor> wanted = rounded.run(library_convolution, torch::kFloat64);
  const std::vector<Tensor> exact = c.run(library_convolution, torch::kFloat64);
  wanted[3] = exact[3];
  test::in_every_kernel_form([&] {
    const std::vector<Tensor> plain = c.run(volume_convolution, torch::kFloat32);
    const MixedProducts scope(MixedForm::kKernels);
    for (const auto format : {torch::MemoryFormat::Contiguous, kChannelsLast}) {
      const std::vector<Tensor> found = c.run(volume_convolution, torch::kFloat32, format);
      EXPECT_TRUE(found[0].is_contiguous(kChannelsLast));
      if (kernels::has_bf16_products()) {
        expect_same_results(found, wanted);
        EXPECT_GT(volume_difference(found[0], exact[0]), 1e-5);
      } else {
        for (std::size_t i = 0; i < 4; ++i) EXPECT_TRUE(torch::equal(found[i], plain[i])) << i;
      }
      const MixedProducts emulated(MixedForm::kEmulated);
      const std::vector<Tensor> same = c.run(volume_convolution, torch::kFloat32, format);
      expect_same_results(same, wanted);
      EXPECT_GT(volume_difference(same[0], exact[0]), 1e-5);
    }
  });
}

// One of everything; odd and even channels of the input; blocks of 32, 16 and 8 output channels and parts of them;
// lines of odd and even numbers of voxels, with tiles of 1 to 12; groups of several lines; several chunks of the
// gradient.
INSTANTIATE_TEST_SUITE_P(
    Sizes, MixedVolumeConvolutionShapes,
    testing::Values(VolumeConvolutionSizes{1, 1, 1, 1, 1, 1}, VolumeConvolutionSizes{2, 3, 4, 5, 2, 8},
                    VolumeConvolutionSizes{2, 4, 3, 13, 3, 16}, VolumeConvolutionSizes{2, 2, 6, 16, 16, 16},
                    VolumeConvolutionSizes{1, 6, 7, 25, 17, 37}, VolumeConvolutionSizes{2, 3, 5, 12, 32, 48},
                    VolumeConvolutionSizes{1, 3, 5, 7, 40, 64}, VolumeConvolutionSizes{2, 5, 3, 11, 40, 56},
                    VolumeConvolutionSizes{1, 3, 3, 3, 3, 3}, VolumeConvolutionSizes{1, 40, 9, 12, 8, 8},
                    VolumeConvolutionSizes{1, 3, 33, 24, 8, 24}));

TEST(MixedVolumeConvolution, TheNumberOfThreadsChangesNoBit) {
  const int before = at::get_num_threads();
  const MixedProducts scope(MixedForm::kKernels);
  for (const VolumeConvolutionSizes& sizes :
       {VolumeConvolutionSizes{2, 7, 5, 9, 40, 20}, VolumeConvolutionSizes{1, 40, 3, 8, 8, 8}}) {
    const VolumeCase c(sizes);
    at::set_num_threads(1);
    const std::vector<Tensor> one = c.run(volume_convolution, torch::kFloat32);
    for (const int threads : {2, 3}) {
      at::set_num_threads(threads);
      const std::vector<Tensor> more = c.run(volume_convolution, torch::kFloat32);
      for (std::size_t i = 0; i < 4; ++i) EXPECT_TRUE(torch::equal(one[i], more[i])) << i << ", " << threads;
    }
  }
  at::set_num_threads(before);
}

// A backward pass multiplies as its forward pass did, whatever has been asked for since.
TEST(MixedVolumeConvolution, BackwardFollowsForward) {
  const VolumeCase c({1, 3, 4, 5, 4, 16});
  const Tensor direction = c.direction.to(torch::kFloat32);
  const auto gradients = [&](MixedForm forward, MixedForm backward) {
    std::vector<Tensor> leaves{c.x.to(torch::kFloat32), c.weight.to(torch::kFloat32), c.bias.to(torch::kFloat32)};
    for (Tensor& leaf : leaves) leaf = leaf.detach().requires_grad_();
    const MixedProducts scope(forward);
    const Tensor out = volume_convolution(leaves[0], leaves[1], leaves[2]);
    set_mixed_products(backward);
    return torch::autograd::grad({out}, leaves, {direction});
  };
  const std::vector<MixedForm> forms = {MixedForm::kNone, MixedForm::kKernels, MixedForm::kEmulated};
  for (const MixedForm forward : forms) {
    const std::vector<Tensor> wanted = gradients(forward, forward);
    for (const MixedForm backward : forms) {
      const std::vector<Tensor> found = gradients(forward, backward);
      for (std::size_t i = 0; i < 3; ++i) EXPECT_TRUE(torch::equal(found[i], wanted[i])) << i;
    }
  }
}

TEST(VolumeConvolution, OnlyGradientsThatAreAskedForAreFormed) {
  const VolumeCase c({1, 3, 4, 5, 2, 3});
  const std::vector<Tensor> all = c.run(volume_convolution, torch::kFloat32);
  Tensor inputs[] = {c.x.to(torch::kFloat32), c.weight.to(torch::kFloat32), c.bias.to(torch::kFloat32)};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) inputs[j] = inputs[j].detach().requires_grad_(i == j);
    const Tensor out = volume_convolution(inputs[0], inputs[1], inputs[2]);
    out.backward(c.direction.to(torch::kFloat32));
    EXPECT_TRUE(torch::equal(inputs[i].grad(), all[i + 1])) << i;
  }
}

TEST(VolumeConvolution, SecondDerivativesAreAnErrorAndNotWrong) {
  const VolumeCase c({1, 3, 3, 3, 2, 2});
  const Tensor x = c.x.to(torch::kFloat32).requires_grad_();
  const Tensor out = volume_convolution(x, c.weight.to(torch::kFloat32), c.bias.to(torch::kFloat32));
  const Tensor direction = c.direction.to(torch::kFloat32);
  EXPECT_THROW(torch::autograd::grad({out}, {x}, {direction}, /*retain_graph=*/true, /*create_graph=*/true),
               c10::Error);
  EXPECT_TRUE(torch::autograd::grad({out}, {x}, {direction})[0].defined());
}

TEST(VolumeConvolution, RejectsWhatItDoesNotSupport) {
  const Tensor x = torch::zeros({1, 2, 4, 4, 4}), weight = torch::zeros({3, 2, 3, 3, 3}), bias = torch::zeros({3});
  EXPECT_TRUE(volume_convolution_supports(x, weight, 1, 1));
  EXPECT_FALSE(volume_convolution_supports(x, weight, 2, 1));
  EXPECT_FALSE(volume_convolution_supports(x, weight, 1, 0));
  EXPECT_FALSE(volume_convolution_supports(x, torch::zeros({3, 2, 1, 1, 1}), 1, 1));
  EXPECT_FALSE(volume_convolution_supports(x, torch::zeros({3, 1, 3, 3, 3}), 1, 1));
  EXPECT_FALSE(volume_convolution_supports(x.to(torch::kFloat64), weight.to(torch::kFloat64), 1, 1));
  EXPECT_FALSE(volume_convolution_supports(x.to(torch::kBFloat16), weight.to(torch::kBFloat16), 1, 1));
  EXPECT_THROW(volume_convolution(x.to(torch::kFloat64), weight, bias), c10::Error);
  EXPECT_THROW(volume_convolution(x, weight, torch::zeros({4})), c10::Error);
  EXPECT_FALSE(patch_convolution_supports(torch::zeros({1, 2, 5, 4, 4}), torch::zeros({3, 2, 2, 2, 2}), 2, 0));
  EXPECT_FALSE(patch_convolution_supports(x, torch::zeros({3, 2, 2, 2, 2}), 1, 0));
}

TEST(PatchConvolution, AgreesWithTheLibraryInDouble) {
  for (const std::int64_t kernel : {1, 2}) {
    const VolumeCase c({2, 4, 6, 8, 3, 5}, kernel, kernel);
    const std::vector<Tensor> wanted = c.run(library_patch_convolution, torch::kFloat64);
    for (const auto format : {torch::MemoryFormat::Contiguous, kChannelsLast}) {
      const std::vector<Tensor> found = c.run(patch_convolution, torch::kFloat32, format);
      EXPECT_TRUE(found[0].is_contiguous(kChannelsLast));
      expect_same_results(found, wanted);
    }
  }
}

// The layer gives the same whether it runs on our code (fp32) or on the library's (fp64).
TEST(Conv3d, OurCodeAndTheLibraryAgree) {
  struct Kind {
    std::int64_t kernel, stride, padding, edge;
  };
  for (const Kind& kind : {Kind{3, 1, 1, 4}, Kind{1, 1, 0, 4}, Kind{2, 2, 0, 4}, Kind{2, 2, 0, 5}, Kind{3, 2, 1, 4}}) {
    torch::manual_seed(23);
    Conv3d layer(6, 10, kind.kernel, kind.stride, kind.padding);
    {
      const torch::NoGradGuard no_grad;
      for (Tensor& parameter : layer->parameters()) parameter.normal_();
    }
    const Tensor x = torch::randn({2, 6, kind.edge, 6, 8});
    const Tensor found = layer->forward(x);
    layer->to(torch::kFloat64);
    const Tensor wanted = layer->forward(x.to(torch::kFloat64));
    ASSERT_EQ(found.sizes(), wanted.sizes());
    EXPECT_LT(volume_difference(found, wanted), 1e-5) << kind.kernel << " of stride " << kind.stride;
  }
}

TEST(ChannelsLastVolumes, NormsAndShufflesKeepFormatAndValues) {
  torch::manual_seed(24);
  const Tensor x = torch::randn({2, 16, 3, 4, 5}), last = x.contiguous(kChannelsLast);
  VolumeNorm norm(16);
  {
    const torch::NoGradGuard no_grad;
    for (Tensor& parameter : norm->parameters()) parameter.normal_();
  }
  const Tensor normed = norm->forward(last), shuffled = pixel_shuffle_3d(last, 2);
  EXPECT_TRUE(normed.is_contiguous(kChannelsLast));
  EXPECT_TRUE(shuffled.is_contiguous(kChannelsLast));
  EXPECT_TRUE(norm->forward(x).is_contiguous());
  EXPECT_TRUE(pixel_shuffle_3d(x, 2).is_contiguous());
  EXPECT_TRUE(torch::equal(normed, norm->forward(x)));
  EXPECT_TRUE(torch::equal(shuffled, pixel_shuffle_3d(x, 2)));
}

}  // namespace
}  // namespace anigen::nn
