#include "anigen/sparse/convolution.h"

#include <ATen/Parallel.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ostream>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/kernels/mixed_products.h"
#include "anigen/nn/kernels/tiles.h"
#include "anigen/sparse/blocks.h"
#include "tests/sparse/attention_cases.h"
#include "tests/support/kernel_forms.h"

namespace anigen::sparse {
namespace {

struct ConvolutionSizes {
  std::vector<std::int64_t> counts;
  std::int64_t side, in, out;
};
std::ostream& operator<<(std::ostream& out, const ConvolutionSizes& s) {
  for (const std::int64_t count : s.counts) out << count << " ";
  return out << "voxels of " << s.side << "^3, " << s.in << " to " << s.out << " channels";
}

// A convolution in fp64 and a direction for its gradient.
struct ConvolutionCase {
  explicit ConvolutionCase(const ConvolutionSizes& s, bool subdivide = false) : side(s.side) {
    torch::manual_seed(21);
    support = Support::create(cases::random_voxels(s.counts, s.side), static_cast<std::int64_t>(s.counts.size()));
    feats = torch::randn({support->size(), s.in}, torch::kFloat64);
    weight = torch::randn({s.out, 3, 3, 3, s.in}, torch::kFloat64);
    bias = torch::randn({s.out}, torch::kFloat64);
    direction = torch::randn({(subdivide ? 8 : 1) * support->size(), s.out}, torch::kFloat64);
  }
  // The output, and the gradients of feats, weight and bias.
  template <typename Convolution>
  std::vector<Tensor> run(const Convolution& convolution, torch::Dtype dtype) const {
    std::vector<Tensor> inputs;
    for (const Tensor& x : {feats, weight, bias}) inputs.push_back(x.to(dtype).detach().clone().requires_grad_());
    const Tensor out = convolution(inputs[0], inputs[1], inputs[2]);
    std::vector<Tensor> results = torch::autograd::grad({out}, inputs, {direction.to(dtype)});
    results.insert(results.begin(), out.detach());
    return results;
  }

  std::int64_t side;
  SupportPtr support;
  Tensor feats, weight, bias, direction;
};

// The rows on a dense grid, and back.
Tensor dense_convolution(const Support& support, std::int64_t side, const Tensor& feats, const Tensor& weight,
                         const Tensor& bias) {
  const Tensor c = support.coords().to(torch::kInt64);
  const Tensor cell = ((c.select(1, 0) * side + c.select(1, 1)) * side + c.select(1, 2)) * side + c.select(1, 3);
  const std::int64_t items = std::max<std::int64_t>(1, support.items().items()), channels = feats.size(1);
  const Tensor grid = torch::zeros({items * side * side * side, channels}, feats.options()).index_add(0, cell, feats);
  const Tensor volume = grid.view({items, side, side, side, channels}).permute({0, 4, 1, 2, 3});
  const Tensor out = torch::conv3d(volume, weight.permute({0, 4, 1, 2, 3}), bias, {1, 1, 1}, {1, 1, 1});
  return out.permute({0, 2, 3, 4, 1}).reshape({-1, weight.size(0)}).index_select(0, cell);
}

// Largest difference as a share of one plus the largest wanted value.
double share_apart(const Tensor& found, const Tensor& wanted) {
  if (wanted.numel() == 0) return found.sizes() == wanted.sizes() ? 0.0 : 1.0;
  return cases::distance(found, wanted) / (1.0 + wanted.abs().max().item<double>());
}

void expect_convolutions_agree(const std::vector<Tensor>& found, const std::vector<Tensor>& wanted, double limit) {
  const char* names[] = {"output", "gradient of feats", "gradient of the weight", "gradient of the bias"};
  ASSERT_EQ(found.size(), wanted.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_EQ(found[i].sizes(), wanted[i].sizes()) << names[i];
    EXPECT_LT(share_apart(found[i], wanted[i]), limit) << names[i];
  }
}

class ConvolutionOfSizes : public testing::TestWithParam<ConvolutionSizes> {};

TEST_P(ConvolutionOfSizes, AgreesWithTheDenseOne) {
  const ConvolutionCase c(GetParam());
  const auto sparse = [&](const Tensor& x, const Tensor& w, const Tensor& b) {
    return submanifold_convolution(*c.support, x, w, b);
  };
  const auto dense = [&](const Tensor& x, const Tensor& w, const Tensor& b) {
    return dense_convolution(*c.support, c.side, x, w, b);
  };
  const std::vector<Tensor> wanted = c.run(dense, torch::kFloat64);
  test::in_every_kernel_form([&] {
    expect_convolutions_agree(c.run(sparse, torch::kFloat64), wanted, 1e-12);
    expect_convolutions_agree(c.run(sparse, torch::kFloat32), wanted, 1e-5);  // sums of up to 27 · 300 terms
  });
}

TEST_P(ConvolutionOfSizes, SubdividedAgreesWithRepeatedRows) {
  const ConvolutionCase c(GetParam(), /*subdivide=*/true);
  const auto folded = [&](const Tensor& x, const Tensor& w, const Tensor& b) {
    return subdivided_convolution(*c.support, x, w, b);
  };
  const auto repeated = [&](const Tensor& x, const Tensor& w, const Tensor& b) {
    const SparseTensor fine = subdivide({c.support, x});
    return submanifold_convolution(*fine.support, fine.feats, w, b);
  };
  const std::vector<Tensor> wanted = c.run(repeated, torch::kFloat64);
  test::in_every_kernel_form([&] {
    expect_convolutions_agree(c.run(folded, torch::kFloat64), wanted, 1e-12);
    expect_convolutions_agree(c.run(folded, torch::kFloat32), wanted, 1e-5);
  });
}

TEST_P(ConvolutionOfSizes, TensorOperationsAgreeWithTheKernels) {
  const ConvolutionCase c(GetParam(), /*subdivide=*/true);
  const Tensor& neighbours = c.support->neighbours();
  for (const TapPlan& plan : {submanifold_plan(), subdivision_plan()}) {
    const Tensor matrices =
        torch::randn({plan.matrices(), c.feats.size(1), c.direction.size(1)}, torch::kFloat64).transpose(1, 2);
    const Tensor from = torch::randn({plan.from_children * c.support->size(), matrices.size(1)}, torch::kFloat64);
    Tensor by_kernels = torch::ones({plan.to_children * c.support->size(), matrices.size(2)}, torch::kFloat64);
    Tensor by_operations = by_kernels.clone();
    add_tensor_tap_product(plan, neighbours, from, matrices, by_operations);
    test::in_every_kernel_form([&] {
      by_kernels.fill_(1.0);
      add_cpu_tap_product(plan, neighbours, from, matrices, by_kernels);
      EXPECT_LT(share_apart(by_kernels, by_operations), 1e-12);
      EXPECT_LT(share_apart(cpu_tap_correlation(plan, neighbours, from, by_kernels),
                            tensor_tap_correlation(plan, neighbours, from, by_kernels)),
                1e-12);
    });
  }
}

// Rounding the factors beforehand gives the same factors; what is left is how sums are rounded.
TEST_P(ConvolutionOfSizes, MixedProductsRoundTheirFactorsAlone) {
  if (!nn::kernels::has_bf16_products()) GTEST_SKIP() << "not supported: products of bf16 numbers on this CPU";
  const auto rounded = [](const Tensor& x) { return x.to(torch::kBFloat16).to(torch::kFloat32); };
  const ConvolutionCase c(GetParam(), /*subdivide=*/false);
  const Tensor& neighbours = c.support->neighbours();
  for (const std::int64_t channels : {16, 18, 48}) {
    for (const TapPlan& plan : {submanifold_plan(), subdivision_plan(), reversed(subdivision_plan())}) {
      const Tensor in = rounded(torch::randn({plan.from_children * c.support->size(), channels}));
      const Tensor matrices = rounded(torch::randn({plan.matrices(), channels, 32}));
      Tensor mixed = torch::ones({plan.to_children * c.support->size(), 32}), wide = mixed.clone();
      add_tap_product(plan, neighbours, in, matrices, mixed, /*mixed=*/true);
      add_tap_product(plan, neighbours, in, matrices, wide);
      EXPECT_LT(share_apart(mixed, wide), 1e-5);
      const Tensor slopes = rounded(mixed);
      EXPECT_LT(share_apart(tap_correlation(plan, neighbours, in, slopes, /*mixed=*/true),
                            tap_correlation(plan, neighbours, in, slopes)),
                1e-5);
    }
  }
}

// Any CPU emulates them: results and gradients are those of rounded factors, the bias has none.
TEST_P(ConvolutionOfSizes, EmulatedProductsRoundTheirFactorsAlone) {
  const auto round = [](const Tensor& x) { return x.to(torch::kFloat32).to(torch::kBFloat16).to(torch::kFloat64); };
  for (const bool subdivide : {false, true}) {
    const ConvolutionCase c(GetParam(), subdivide);
    const auto convolution = [&](const Tensor& x, const Tensor& w, const Tensor& b) {
      return subdivide ? subdivided_convolution(*c.support, x, w, b) : submanifold_convolution(*c.support, x, w, b);
    };
    ConvolutionCase rounded = c;
    for (Tensor* x : {&rounded.feats, &rounded.weight, &rounded.direction}) *x = round(*x);
    std::vector<Tensor> wanted = rounded.run(convolution, torch::kFloat64);
    wanted[3] = c.run(convolution, torch::kFloat64)[3];
    const nn::MixedProducts emulated(nn::MixedForm::kEmulated);
    // Weights of a subdivision are added up before they are rounded.
    expect_convolutions_agree(c.run(convolution, torch::kFloat32), wanted, subdivide ? 2e-2 : 1e-5);
  }
}

// Nothing; one voxel; no two neighbours; several items, one empty; all cells of a grid but one; channels that fill the
// tiles of the kernels, and that do not; more rows and channels than a block of them.
INSTANTIATE_TEST_SUITE_P(Sizes, ConvolutionOfSizes,
                         testing::Values(ConvolutionSizes{{0}, 3, 2, 3}, ConvolutionSizes{{1}, 2, 1, 1},
                                         ConvolutionSizes{{2, 1}, 9, 3, 2}, ConvolutionSizes{{40, 0, 90}, 6, 5, 17},
                                         ConvolutionSizes{{124}, 5, 16, 32}, ConvolutionSizes{{700, 300}, 11, 13, 22},
                                         ConvolutionSizes{{60}, 5, 300, 33}));

TEST(Convolution, GradientMatchesFiniteDifferences) {
  const ConvolutionCase c({{30, 20}, 4, 3, 5});
  const auto loss = [&](const Tensor& x, const Tensor& w, const Tensor& b) {
    return (submanifold_convolution(*c.support, x, w, b) * c.direction).sum().item<double>();
  };
  const auto convolution = [&](const Tensor& x, const Tensor& w, const Tensor& b) {
    return submanifold_convolution(*c.support, x, w, b);
  };
  const std::vector<Tensor> gradients = c.run(convolution, torch::kFloat64);
  const Tensor dx = torch::randn_like(c.feats), dw = torch::randn_like(c.weight), db = torch::randn_like(c.bias);
  const double h = 1e-4;  // a quadratic function: the central difference is exact but for rounding, ~ 1e-14 / h
  const double slope = (loss(c.feats + h * dx, c.weight + h * dw, c.bias + h * db) -
                        loss(c.feats - h * dx, c.weight - h * dw, c.bias - h * db)) /
                       (2 * h);
  const double found =
      ((gradients[1] * dx).sum() + (gradients[2] * dw).sum() + (gradients[3] * db).sum()).item<double>();
  EXPECT_NEAR(found, slope, 1e-8 * (1.0 + std::abs(slope)));
}

KERNEL_TEST(Convolution, TheSameBitsForAnyNumberOfThreads) {
  const int before = at::get_num_threads();
  const ConvolutionCase plain({{1500}, 14, 24, 40}), subdivided({{400}, 9, 24, 40}, /*subdivide=*/true);
  const auto run = [&] {
    std::vector<Tensor> results =
        plain.run([&](const Tensor& x, const Tensor& w,
                      const Tensor& b) { return submanifold_convolution(*plain.support, x, w, b); },
                  torch::kFloat32);
    const std::vector<Tensor> more =
        subdivided.run([&](const Tensor& x, const Tensor& w,
                           const Tensor& b) { return subdivided_convolution(*subdivided.support, x, w, b); },
                       torch::kFloat32);
    results.pop_back();  // the bias is summed by the library
    results.push_back(more[1]);
    return results;
  };
  at::set_num_threads(1);
  const std::vector<Tensor> one = run();
  for (const int threads : {2, 3, 7}) {
    at::set_num_threads(threads);
    const std::vector<Tensor> found = run();
    for (std::size_t i = 0; i < one.size(); ++i) EXPECT_TRUE(torch::equal(found[i], one[i])) << i << ", " << threads;
  }
  at::set_num_threads(before);
}

KERNEL_TEST(Convolution, OrderOfRowsDoesNotMatter) {
  const ConvolutionCase c({{200}, 7, 6, 4});
  const Tensor order = torch::randperm(200);
  const SupportPtr shuffled = Support::create(c.support->coords().index_select(0, order));
  const Tensor wanted = submanifold_convolution(*c.support, c.feats, c.weight, c.bias).index_select(0, order);
  const Tensor found = submanifold_convolution(*shuffled, c.feats.index_select(0, order), c.weight, c.bias);
  EXPECT_TRUE(torch::equal(found, wanted));
}

KERNEL_TEST(Convolution, SixteenBitInputs) {
  // The second and third as the kernels for bf16 take them, one panel of columns and several; the first as they do not.
  for (const ConvolutionCase& c : {ConvolutionCase({{150}, 6, 20, 10}), ConvolutionCase({{170}, 6, 16, 48}),
                                   ConvolutionCase({{140}, 6, 272, 80})}) {
    for (const auto& [dtype, digits] : {std::pair(torch::kBFloat16, 8), std::pair(torch::kHalf, 11)}) {
      ConvolutionCase rounded = c;  // so that only our own rounding counts: of the results
      for (Tensor* x : {&rounded.feats, &rounded.weight, &rounded.bias, &rounded.direction})
        *x = x->to(dtype).to(torch::kFloat64);
      const auto convolution = [&](const Tensor& x, const Tensor& w, const Tensor& b) {
        return submanifold_convolution(*c.support, x, w, b);
      };
      const std::vector<Tensor> found = rounded.run(convolution, dtype);
      EXPECT_EQ(found[0].scalar_type(), dtype);
      EXPECT_EQ(found[2].scalar_type(), dtype);
      expect_convolutions_agree(found, rounded.run(convolution, torch::kFloat64), 2.0 * std::exp2(-digits));
    }
  }
}

TEST(Convolution, OnlyTheGradientsThatAreNeeded) {
  const ConvolutionCase c({{50}, 5, 4, 6});
  const Tensor frozen = c.feats, weight = c.weight.clone().requires_grad_();
  const Tensor out = submanifold_convolution(*c.support, frozen, weight, Tensor());
  EXPECT_TRUE(torch::autograd::grad({out.sum()}, {weight})[0].defined());
  const torch::NoGradGuard no_grad;
  EXPECT_FALSE(submanifold_convolution(*c.support, frozen, weight, Tensor()).requires_grad());
}

TEST(Convolution, SecondDerivativesAreAnErrorAndNotWrong) {
  const ConvolutionCase c({{20}, 4, 2, 3});
  const Tensor x = c.feats.clone().requires_grad_();
  const Tensor out = submanifold_convolution(*c.support, x, c.weight, c.bias);
  EXPECT_THROW(torch::autograd::grad({out}, {x}, {c.direction}, /*retain_graph=*/true, /*create_graph=*/true),
               c10::Error);
}

KERNEL_TEST(Convolution, NotFiniteRowsReachTheirNeighboursOnly) {
  const SupportPtr support =
      Support::create(torch::tensor({0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 3}, torch::kInt32).view({3, 4}));
  Tensor feats = torch::ones({3, 5});
  feats[0][2] = std::nan("");
  const Tensor out = submanifold_convolution(*support, feats, torch::ones({7, 3, 3, 3, 5}), Tensor());
  EXPECT_TRUE(out[0].isnan().all().item<bool>());
  EXPECT_TRUE(out[1].isnan().all().item<bool>());
  EXPECT_TRUE(torch::equal(out[2], torch::full({7}, 5.0)));
}

TEST(Convolution, RejectsWhatDoesNotFit) {
  const ConvolutionCase c({{20}, 4, 2, 3});
  EXPECT_THROW(submanifold_convolution(*c.support, c.feats.slice(0, 1), c.weight, c.bias), c10::Error);
  EXPECT_THROW(submanifold_convolution(*c.support, c.feats.slice(1, 1), c.weight, c.bias), c10::Error);
  EXPECT_THROW(submanifold_convolution(*c.support, c.feats, c.weight.slice(1, 1), c.bias), c10::Error);
  EXPECT_THROW(submanifold_convolution(*c.support, c.feats, c.weight, c.bias.slice(0, 1)), c10::Error);
  EXPECT_THROW(submanifold_convolution(*c.support, c.feats.to(torch::kFloat32), c.weight, c.bias), c10::Error);
  EXPECT_THROW(SubmanifoldConv3d(2, 3, 5), NotSupportedError);
}

TEST(SubmanifoldConv3d, KernelOfOneReadsTheWeightWithoutTransposing) {
  torch::manual_seed(22);
  const SparseTensor x = cases::random_sparse({30}, 5, 4);
  SubmanifoldConv3d convolution(4, 6, 1);
  cases::draw_parameters(*convolution, torch::kFloat32);
  EXPECT_EQ(cases::parameter_keys(*convolution), (std::vector<std::string>{"conv.weight", "conv.bias"}));
  EXPECT_EQ(convolution->conv->weight.sizes(), (std::vector<std::int64_t>{6, 1, 1, 1, 4}));
  const Tensor flat = convolution->conv->weight.flatten();
  Tensor wanted = torch::zeros({30, 6});
  for (std::int64_t i = 0; i < 4; ++i) {
    for (std::int64_t o = 0; o < 6; ++o) wanted.select(1, o).add_(x.feats.select(1, i) * flat[i * 6 + o]);
  }
  wanted.add_(convolution->conv->bias);
  EXPECT_LT(cases::distance(convolution->forward(x).feats, wanted.detach()), 1e-5);
}

TEST(SubmanifoldConv3d, InitialValues) {
  torch::manual_seed(23);
  SubmanifoldConv3d convolution(8, 64);
  default_submanifold_kernels(*convolution);
  const double bound = 1.0 / std::sqrt(27.0 * 8.0);
  for (const Tensor& parameter : convolution->parameters()) {
    EXPECT_LE(parameter.abs().max().item<double>(), bound);
    EXPECT_GT(parameter.abs().max().item<double>(), 0.9 * bound);
  }
  nn::cast_linears(*convolution, torch::kHalf);
  for (const Tensor& parameter : convolution->parameters()) EXPECT_EQ(parameter.scalar_type(), torch::kHalf);
}

}  // namespace
}  // namespace anigen::sparse
