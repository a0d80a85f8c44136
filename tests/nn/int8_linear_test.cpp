#include "anigen/nn/int8_linear.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/linear.h"
#include "tests/support/kernel_forms.h"

namespace anigen::nn {
namespace {

using kernels::Int8Matrix;

struct Int8Sizes {
  std::int64_t rows, in, out;
};

// Whole groups and panels, parts of them, one row, more rows than a block and fewer than a tile has.
const std::vector<Int8Sizes> kInt8Sizes = {{48, 128, 64}, {1, 64, 64}, {7, 200, 72}, {301, 384, 130}, {5, 1024, 16}};

Int8Matrix int8_of(const Tensor& weight) {
  const Tensor dense = weight.contiguous();
  return kernels::round_to_int8(dense.data_ptr<float>(), dense.size(0), dense.size(1));
}

Tensor widened_int8(const Int8Matrix& matrix) {
  const Tensor weight = torch::empty({matrix.columns, matrix.depth});
  kernels::widen_int8(matrix, weight.data_ptr<float>());
  return weight;
}

// Rows as they are multiplied, in fp64: integers times scales, by LibTorch's operators.
Tensor int8_rows_of(const Tensor& x) {
  std::vector<Tensor> groups;
  for (const Tensor& group : x.split(kernels::kInt8Group, -1)) {
    const Tensor scale = group.abs().amax(-1, /*keepdim=*/true) / 127.0F;
    groups.push_back(
        torch::where(scale > 0, torch::round(group / scale), torch::zeros_like(group)).to(torch::kFloat64) *
        scale.to(torch::kFloat64));
  }
  return torch::cat(groups, -1);
}

KERNEL_TEST(Int8Linear, MultipliesTheRoundedFactors) {
  for (const Int8Sizes& size : kInt8Sizes) {
    torch::manual_seed(size.rows);
    const Tensor x = torch::randn({size.rows, size.in}), weight = 0.03 * torch::randn({size.out, size.in});
    const Tensor bias = torch::randn({size.out});
    const Int8Matrix matrix = int8_of(weight);
    const Tensor exact =
        torch::linear(int8_rows_of(x), widened_int8(matrix).to(torch::kFloat64), bias.to(torch::kFloat64));
    // A row's integers may fall to the other side of a tie; else sums of at most eight groups in fp32 are off.
    const double error =
        (int8_linear(x, matrix, bias) - exact).abs().max().item<double>() / exact.abs().max().item<double>();
    EXPECT_LT(error, 5e-4) << size.rows << " x " << size.in << " x " << size.out;
  }
}

// Integers and sums are those of fp32 rows; results are rounded once, where they are written.
KERNEL_TEST(Int8Linear, RoundsResultsOfBfloat16RowsOnce) {
  for (const Int8Sizes& size : kInt8Sizes) {
    torch::manual_seed(size.rows);
    const Tensor x = torch::randn({size.rows, size.in}).to(torch::kBFloat16);
    const Tensor bias = torch::randn({size.out}).to(torch::kBFloat16);
    const Int8Matrix matrix = int8_of(0.03 * torch::randn({size.out, size.in}));
    const Tensor y = int8_linear(x, matrix, bias), wide = int8_linear(x.to(torch::kFloat32), matrix, bias);
    ASSERT_EQ(y.scalar_type(), torch::kBFloat16);
    ASSERT_EQ(wide.scalar_type(), torch::kFloat32);
    EXPECT_TRUE(torch::equal(y, wide.to(torch::kBFloat16))) << size.rows << " x " << size.in << " x " << size.out;
    EXPECT_EQ(int8_linear(x.slice(0, 0, 0), matrix, bias).sizes(), (std::vector<std::int64_t>{0, size.out}));
  }
}

TEST(Int8Linear, TakesRowsThatAreColumnsOfAWiderTensor) {
  torch::manual_seed(7);
  const Int8Matrix matrix = int8_of(torch::randn({80, 128}));
  for (const torch::Dtype dtype : {torch::kFloat32, torch::kBFloat16}) {
    const Tensor x = torch::randn({50, 300}).to(dtype).slice(1, 100, 228);
    EXPECT_TRUE(torch::equal(int8_linear(x, matrix, {}), int8_linear(x.contiguous(), matrix, {})));
  }
}

TEST(Int8Linear, FormsAgreeToTheRoundingOfSums) {
  torch::manual_seed(2);
  const Tensor x = torch::randn({100, 512});
  const Int8Matrix matrix = int8_of(torch::randn({256, 512}));
  Tensor first;
  for (const KernelForm form : runnable_kernel_forms()) {
    const KernelFormScope scope(form);
    const Tensor y = int8_linear(x, matrix, {});
    if (!first.defined()) first = y;
    EXPECT_LT(((y - first).abs().max() / first.abs().max()).item<double>(), 1e-3) << kernel_form_name(form);
  }
}

TEST(Int8Linear, IsNearTheLinearLayer) {
  torch::manual_seed(3);
  const Tensor x = torch::randn({256, 1024}), weight = torch::randn({512, 1024});
  const Tensor exact = torch::linear(x, weight), found = int8_linear(x, int8_of(weight), {});
  // Uniform rounding of both factors: σ of a rounded normal number is scale / √12, scale about 2.7 σ / 127.
  EXPECT_LT(((found - exact).norm() / exact.norm()).item<double>(), 0.012);
  EXPECT_GT(((found - exact).norm() / exact.norm()).item<double>(), 0.004);
}

TEST(Int8Linear, KeepsWeightsThatWereStoredInEightBits) {
  torch::manual_seed(4);
  const Tensor scales = torch::rand({40, 1}) + 0.01;
  Tensor integers = torch::randint(-127, 128, {40, 300}).to(torch::kFloat32);
  integers.select(1, 7).fill_(127.0F);  // the largest of each row
  const Tensor weight = integers * scales;
  EXPECT_TRUE(torch::allclose(widened_int8(int8_of(weight)), weight, 1e-6, 0.0));
}

TEST(Int8Linear, HandlesZerosAndPassesOnWhatIsNotFinite) {
  Tensor x = torch::zeros({4, 128});
  x[1].fill_(std::numeric_limits<float>::quiet_NaN());
  x[2][5] = std::numeric_limits<float>::infinity();
  x[3].fill_(1.0F);
  const Tensor y = int8_linear(x, int8_of(torch::ones({64, 128})), {});
  EXPECT_EQ(y[0].abs().max().item<float>(), 0.0F);
  EXPECT_TRUE(torch::isnan(y[1]).all().item<bool>());
  EXPECT_FALSE(torch::isfinite(y[2]).any().item<bool>());
  const Tensor narrow = int8_linear(x.to(torch::kBFloat16), int8_of(torch::ones({64, 128})), {});
  EXPECT_TRUE(torch::equal(torch::isfinite(narrow), torch::isfinite(y)));
  EXPECT_NEAR(y[3][0].item<float>(), 128.0F, 0.01F);
  // So small that 127 over it is no number: nothing, and not NaN.
  EXPECT_EQ(int8_linear(torch::full({2, 128}, 1e-38F), int8_of(torch::ones({64, 128})), {}).abs().max().item<float>(),
            0.0F);
  EXPECT_EQ(int8_linear(torch::zeros({0, 128}), int8_of(torch::ones({64, 128})), {}).sizes(),
            (std::vector<std::int64_t>{0, 64}));
}

TEST(Int8Linear, DoesNotDependOnTheNumberOfThreads) {
  torch::manual_seed(5);
  const Int8Matrix matrix = int8_of(torch::randn({200, 256}));
  for (const std::int64_t rows : {3, 900}) {  // threads share columns, and rows
    const Tensor x = torch::randn({rows, 256});
    const int before = at::get_num_threads();
    at::set_num_threads(1);
    const Tensor one = int8_linear(x, matrix, {});
    at::set_num_threads(2);
    EXPECT_TRUE(torch::equal(int8_linear(x, matrix, {}), one));
    at::set_num_threads(before);
  }
}

Linear filled_linear(std::int64_t in, std::int64_t out) {
  Linear layer(in, out);
  for (const Tensor& parameter : layer->parameters()) torch::nn::init::normal_(parameter, 0.0, 0.05);
  return layer;
}

TEST(Int8Linear, QuantizesWideLayersOnce) {
  torch::manual_seed(6);
  Linear wide = filled_linear(128, 256);
  Linear narrow = filled_linear(128, 8);
  const torch::NoGradGuard no_grad;
  const Tensor x = torch::randn({2, 9, 128}), before = wide->forward(x);
  EXPECT_FALSE(quantizes(*narrow));
  ASSERT_TRUE(quantizes(*wide));
  quantize(*wide, "weight");
  EXPECT_FALSE(quantizes(*wide));
  EXPECT_EQ(wide->weight.numel(), 0);
  const Tensor after = wide->forward(x);
  EXPECT_EQ(after.sizes(), before.sizes());
  EXPECT_LT(((after - before).norm() / before.norm()).item<double>(), 0.02);
}

TEST(Int8Linear, RefusesWeightsThatAreNotFinite) {
  Linear layer = filled_linear(64, 64);
  layer->weight.data()[3][4] = std::numeric_limits<float>::quiet_NaN();
  try {
    quantize(*layer, "blocks.0.weight");
    FAIL() << "no error";
  } catch (const InputError& error) {
    EXPECT_EQ(error.place(), "blocks.0.weight");
  }
}

}  // namespace
}  // namespace anigen::nn
