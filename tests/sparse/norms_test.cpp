#include "anigen/sparse/norms.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "tests/sparse/attention_cases.h"
#include "tests/support/kernel_forms.h"

namespace anigen::sparse {
namespace {

constexpr double kNormEps = 1e-5;

// Rows of several items, the middle one empty, parameters and a direction for the gradient, fp64.
struct GroupNormCase {
  explicit GroupNormCase(std::vector<std::int64_t> lengths, std::int64_t channels, double offset = 0.5)
      : items(std::move(lengths)) {
    torch::manual_seed(41);
    feats = 2.0 * torch::randn({items.rows(), channels}, torch::kFloat64) + offset;
    weight = torch::randn({channels}, torch::kFloat64);
    bias = torch::randn({channels}, torch::kFloat64);
    direction = torch::randn_like(feats);
  }
  template <typename Norm>
  std::vector<Tensor> run(const Norm& norm, torch::Dtype dtype) const {
    std::vector<Tensor> inputs;
    for (const Tensor& x : {feats, weight, bias}) inputs.push_back(x.to(dtype).detach().clone().requires_grad_());
    const Tensor out = norm(inputs[0], inputs[1], inputs[2]);
    std::vector<Tensor> results = torch::autograd::grad({out}, inputs, {direction.to(dtype)});
    results.insert(results.begin(), out.detach());
    return results;
  }
  auto ours(std::int64_t groups, bool silu = false) const {
    return [this, groups, silu](const Tensor& x, const Tensor& w, const Tensor& b) {
      return sparse_group_norm(x, items, w, b, groups, kNormEps, silu);
    };
  }
  // The library's norm of each item as a volume [1, C, n].
  auto of_volumes(std::int64_t groups) const {
    return [this, groups](const Tensor& x, const Tensor& w, const Tensor& b) {
      std::vector<Tensor> rows;
      for (const Tensor& item : items.split(x)) {
        if (item.size(0) == 0) continue;
        rows.push_back(torch::group_norm(item.t().unsqueeze(0), groups, w, b, kNormEps).squeeze(0).t());
      }
      return torch::cat(rows, 0);
    };
  }

  nn::Ragged items;
  Tensor feats, weight, bias, direction;
};

void expect_norms_agree(const std::vector<Tensor>& found, const std::vector<Tensor>& wanted, double limit) {
  const char* names[] = {"output", "gradient of feats", "gradient of the weight", "gradient of the bias"};
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_EQ(found[i].sizes(), wanted[i].sizes()) << names[i];
    EXPECT_LT(cases::distance(found[i], wanted[i]), limit * (1.0 + wanted[i].abs().max().item<double>())) << names[i];
  }
}

TEST(SparseGroupNorm, IsGroupNormOfEachItem) {
  // The last has several blocks of rows.
  const std::vector<std::vector<std::int64_t>> batches{{5, 0, 9}, {1}, {9000, 40}};
  for (const std::vector<std::int64_t>& lengths : batches) {
    const GroupNormCase c(lengths, 12);
    for (const std::int64_t groups : {1, 3, 12}) {
      const std::vector<Tensor> wanted = c.run(c.of_volumes(groups), torch::kFloat64);
      expect_norms_agree(c.run(c.ours(groups), torch::kFloat64), wanted, 1e-10);
      // fp32: statistics to some 1e-7, gradients of the parameters sums of up to 9000 terms. A single voxel whose
      // groups are single channels is divided by √eps, which multiplies rounding by 300.
      expect_norms_agree(c.run(c.ours(groups), torch::kFloat32), wanted, c.items.rows() == 1 ? 1e-3 : 2e-5);
    }
  }
}

KERNEL_TEST(SparseGroupNorm, WithSiluIsSiluOfTheNorm) {
  for (const std::vector<std::int64_t>& lengths : {std::vector<std::int64_t>{5, 0, 9}, {9000, 40}}) {
    const GroupNormCase c(lengths, 12);
    const auto norm = c.of_volumes(3);
    const std::vector<Tensor> wanted = c.run(
        [&](const Tensor& x, const Tensor& w, const Tensor& b) { return torch::silu(norm(x, w, b)); }, torch::kFloat64);
    expect_norms_agree(c.run(c.ours(3, /*silu=*/true), torch::kFloat64), wanted, 1e-10);
    expect_norms_agree(c.run(c.ours(3, /*silu=*/true), torch::kFloat32), wanted, 2e-5);
    const torch::NoGradGuard no_grad;
    EXPECT_LT(cases::distance(c.ours(3, true)(c.feats, c.weight, c.bias), wanted[0]), 1e-10);
  }
}

TEST(SparseGroupNorm, BitsDoNotDependOnThreads) {
  const GroupNormCase c({9000, 40}, 32);
  const int before = torch::get_num_threads();
  std::vector<Tensor> first;
  for (const int threads : {1, 2, 3}) {
    torch::set_num_threads(threads);
    const std::vector<Tensor> found = c.run(c.ours(8, /*silu=*/true), torch::kFloat32);
    if (first.empty()) first = found;
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_TRUE(torch::equal(found[i], first[i])) << i;
  }
  torch::set_num_threads(before);
}

TEST(SparseGroupNorm, GradientMatchesFiniteDifferences) {
  const GroupNormCase c({7, 4}, 6);
  const auto norm = c.ours(2);
  const auto loss = [&](const Tensor& x, const Tensor& w, const Tensor& b) {
    return (norm(x, w, b) * c.direction).sum().item<double>();
  };
  const std::vector<Tensor> gradients = c.run(norm, torch::kFloat64);
  const Tensor dx = torch::randn_like(c.feats), dw = torch::randn_like(c.weight), db = torch::randn_like(c.bias);
  const double h = 1e-5;  // error of the central difference ~ h² third derivative, of rounding ~ 1e-14 / h
  const double slope = (loss(c.feats + h * dx, c.weight + h * dw, c.bias + h * db) -
                        loss(c.feats - h * dx, c.weight - h * dw, c.bias - h * db)) /
                       (2 * h);
  const double found =
      ((gradients[1] * dx).sum() + (gradients[2] * dw).sum() + (gradients[3] * db).sum()).item<double>();
  EXPECT_NEAR(found, slope, 1e-6 * (1.0 + std::abs(slope)));
}

TEST(SparseGroupNorm, ALargeMeanDoesNotDrownTheVariance) {
  const GroupNormCase c({3000}, 4, /*offset=*/1000.0);
  const Tensor wanted = c.run(c.of_volumes(2), torch::kFloat64)[0], found = c.run(c.ours(2), torch::kFloat32)[0];
  // The inputs themselves are rounded at 1000 · 2⁻²⁴ = 6e-5 of their spread of 2.
  EXPECT_LT(cases::distance(found, wanted), 5e-4);
}

TEST(SparseGroupNorm, SixteenBitInputsWithFullParameters) {
  const GroupNormCase c({300, 50}, 8);
  const Tensor feats = c.feats.to(torch::kHalf), weight = c.weight.to(torch::kFloat32),
               bias = c.bias.to(torch::kFloat32);
  const Tensor found = sparse_group_norm(feats, c.items, weight, bias, 4, kNormEps);
  EXPECT_EQ(found.scalar_type(), torch::kHalf);
  const Tensor wanted = sparse_group_norm(feats.to(torch::kFloat64), c.items, c.weight, c.bias, 4, kNormEps);
  EXPECT_LT(cases::distance(found, wanted), 0.01);  // values below 16: half a unit in the last place is 0.004
}

TEST(SparseGroupNorm, ModuleOnASupport) {
  torch::manual_seed(42);
  const SparseTensor x = cases::random_sparse({30, 0, 20}, 5, 64);
  SparseGroupNorm norm(64);
  default_group_norms(*norm);
  EXPECT_EQ(cases::parameter_keys(*norm), (std::vector<std::string>{"weight", "bias"}));
  const SparseTensor y = norm->forward(x);
  EXPECT_EQ(y.support, x.support);
  const Tensor first = y.feats.detach().narrow(0, 0, 30).view({30, 32, 2}).transpose(0, 1).reshape({32, 60});
  EXPECT_LT(first.mean(1).abs().max().item<double>(), 1e-5);
  EXPECT_LT((first.square().mean(1) - 1.0).abs().max().item<double>(), 1e-3);
}

TEST(SparseGroupNorm, NoRowsAtAll) {
  const nn::Ragged items({0, 0});
  const Tensor feats = torch::zeros({0, 4}).requires_grad_(), weight = torch::ones({4}).requires_grad_();
  const Tensor out = sparse_group_norm(feats, items, weight, torch::zeros({4}), 2, kNormEps);
  EXPECT_EQ(out.sizes(), feats.sizes());
  EXPECT_TRUE(torch::equal(torch::autograd::grad({out.sum()}, {weight})[0], torch::zeros({4})));
}

TEST(SparseGroupNorm, NotFiniteValuesStayInTheirItemAndGroup) {
  GroupNormCase c({4, 3}, 4);
  c.feats[1][0] = std::nan("");
  for (const torch::Dtype dtype : {torch::kFloat64, torch::kFloat32}) {
    const Tensor out = c.run(c.ours(2), dtype)[0];
    EXPECT_TRUE(out.narrow(0, 0, 4).narrow(1, 0, 2).isnan().all().item<bool>());
    EXPECT_TRUE(out.narrow(0, 0, 4).narrow(1, 2, 2).isfinite().all().item<bool>());
    EXPECT_TRUE(out.narrow(0, 4, 3).isfinite().all().item<bool>());
  }
}

TEST(SparseGroupNorm, RejectsWhatDoesNotFit) {
  const GroupNormCase c({4, 3}, 6);
  EXPECT_THROW(sparse_group_norm(c.feats, c.items, c.weight, c.bias, 4, kNormEps), c10::Error);
  EXPECT_THROW(sparse_group_norm(c.feats.slice(0, 1), c.items, c.weight, c.bias, 2, kNormEps), c10::Error);
  EXPECT_THROW(sparse_group_norm(c.feats, c.items, c.weight.slice(0, 1), c.bias, 2, kNormEps), c10::Error);
  EXPECT_THROW(SparseGroupNorm(30, 32), c10::Error);
}

}  // namespace
}  // namespace anigen::sparse
