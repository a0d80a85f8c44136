#include "anigen/nn/kernels/tiles.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "anigen/nn/torch.h"
#include "tests/support/kernel_forms.h"

namespace anigen::nn::products {
namespace {

using torch::Tensor;

// A matrix in rows that are longer than it needs, with `filler` behind its columns.
Tensor stored(const Tensor& matrix, std::int64_t stride, double filler) {
  Tensor rows = torch::full({matrix.size(0), stride}, filler, torch::kFloat32);
  rows.narrow(1, 0, matrix.size(1)).copy_(matrix);
  return rows;
}

Block block_of(const Tensor& rows) { return {rows.data_ptr<float>(), rows.size(1)}; }

// fp32 sums of `depth` products of size one, against fp64.
double product_error(const Tensor& found, const Tensor& wanted) {
  return (found.to(torch::kFloat64) - wanted).abs().max().item<double>();
}

KERNEL_TEST(SmallProducts, EveryNumberOfRowsAndColumns) {
  torch::manual_seed(31);
  constexpr std::int64_t kDepth = 37;
  const Tensor left = torch::randn({40, kDepth}), right = torch::randn({kDepth, 150});
  const Tensor wanted = left.to(torch::kFloat64).mm(right.to(torch::kFloat64));
  for (std::int64_t rows = 1; rows <= 40; ++rows) {
    for (const std::int64_t columns : {1, 15, 16, 17, 32, 40, 64, 100, 112, 150}) {
      const Tensor a = stored(left.narrow(0, 0, rows), kDepth + 3, 7.0);
      const Tensor b = stored(right.narrow(1, 0, columns), spread_stride(columns), 0.0);
      const Tensor out = torch::full({rows, spread_stride(columns)}, 5.0F);
      multiply({rows, columns, kDepth}, block_of(a).plain(), block_of(b), block_of(out), /*accumulate=*/false);
      const Tensor expected = wanted.narrow(0, 0, rows).narrow(1, 0, columns);
      EXPECT_LT(product_error(out.narrow(1, 0, columns), expected), 1e-4) << rows << "x" << columns;
      // Nothing is written beyond the multiple of kLanes.
      EXPECT_TRUE((out.narrow(1, padded(columns), out.size(1) - padded(columns)) == 5.0).all().item<bool>());
    }
  }
}

KERNEL_TEST(SmallProducts, TransposedLeftFactorAndAccumulation) {
  torch::manual_seed(32);
  for (const std::int64_t rows : {1, 5, 13, 64}) {
    const Tensor left = torch::randn({29, rows}), right = torch::randn({29, 16}), start = torch::randn({rows, 16});
    const Tensor out = start.clone();
    multiply({rows, 16, 29}, block_of(left).transposed(), block_of(right), block_of(out), /*accumulate=*/true);
    const Tensor wanted = start.to(torch::kFloat64) + left.to(torch::kFloat64).t().mm(right.to(torch::kFloat64));
    EXPECT_LT(product_error(out, wanted), 1e-4) << rows;
  }
}

#if defined(__x86_64__) && defined(NDEBUG) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
// Forms with fused multiply-adds keep what the portable one rounds away. Builds that hardly optimise fuse nothing.
TEST(SmallProducts, FormsAreThoseAskedFor) {
  const Tensor left = torch::tensor({{1.0F, 1.0F + 1.0F / 4096.0F}}), right = torch::zeros({2, 16});
  right[0].fill_(-1.0F - 1.0F / 2048.0F);
  right[1].fill_(1.0F + 1.0F / 4096.0F);  // its square is 1 + 2^-11 + 2^-24
  test::in_every_kernel_form([&] {
    const Tensor out = torch::empty({1, 16});
    multiply({1, 16, 2}, block_of(left).plain(), block_of(right), block_of(out), /*accumulate=*/false);
    const float kept = kernel_form() >= KernelForm::kAvx2 ? 1.0F / 16777216.0F : 0.0F;
    EXPECT_TRUE((out == kept).all().item<bool>()) << out;
  });
}
#endif

KERNEL_TEST(SmallProducts, ARowDoesNotDependOnTheOthers) {
  torch::manual_seed(33);
  const Tensor left = torch::randn({25, 64}), right = torch::randn({64, 112});
  const Tensor all = torch::empty({25, 112});
  multiply({25, 112, 64}, block_of(left).plain(), block_of(right), block_of(all), false);
  for (std::int64_t r = 0; r < 25; ++r) {
    const Tensor one = torch::empty({1, 112});
    multiply({1, 112, 64}, block_of(left).from_row(r).plain(), block_of(right), block_of(one), false);
    EXPECT_TRUE(torch::equal(one[0], all[r])) << r;
  }
}

KERNEL_TEST(SmallProducts, RowsAheadChangeNothing) {
  torch::manual_seed(34);
  const Tensor next = torch::randn({300, 64}), untouched = next.clone();
  for (const std::int64_t rows : {1, 5, 25, 140}) {
    for (const std::int64_t columns : {16, 32, 48, 64, 112, 144}) {
      const ProductSize size{rows, columns, 37};
      const Tensor left = torch::randn({rows, 37}), right = torch::randn({37, columns});
      const Tensor plain = torch::empty({rows, columns}), asking = torch::empty({rows, columns});
      multiply(size, block_of(left).plain(), block_of(right), block_of(plain), false);
      RowsAhead ahead;
      ahead.add(next.data_ptr<float>(), 300, 64 * sizeof(float), 64 * sizeof(float));
      ahead.spread_over(asking_calls(size));
      multiply(size, block_of(left).plain(), block_of(right), block_of(asking), false, ahead);
      EXPECT_TRUE(torch::equal(asking, plain));
      EXPECT_EQ(ahead.left(), 0) << rows << "x" << columns;
    }
  }
  EXPECT_TRUE(torch::equal(next, untouched));
}

TEST(RowsAhead, AskForAllRowsInSoManyCalls) {
  const Tensor a = torch::zeros({7, 40}), b = torch::zeros({5, 3});
  RowsAhead ahead;
  ahead.add(a.data_ptr<float>(), 7, 160, 160);
  ahead.add(b.data_ptr<float>(), 0, 12, 12);  // no rows
  ahead.add(b.data_ptr<float>(), 5, 12, 12);
  ahead.spread_over(5);
  for (int call = 0; call < 5; ++call) {
    EXPECT_EQ(ahead.left(), std::max(0, 12 - 3 * call)) << call;
    ahead.ask();
  }
  ahead.ask();  // nothing is left to ask for
  EXPECT_EQ(ahead.left(), 0);
}

TEST(SmallProducts, Transpose) {
  const Tensor in = torch::arange(12 * 20, torch::kFloat32).view({12, 20}), out = torch::zeros({16, 24});
  transpose(12, 16, block_of(in), block_of(out));
  EXPECT_TRUE(torch::equal(out.narrow(1, 0, 12), in.narrow(1, 0, 16).t()));
  EXPECT_TRUE((out.narrow(1, 12, 12) == 0).all().item<bool>());
}

TEST(SmallProducts, StridesAreAnOddNumberOfCacheLines) {
  for (const std::int64_t columns : {1, 16, 17, 31, 32, 33, 64, 100, 256}) {
    EXPECT_GE(spread_stride(columns), padded(columns));
    EXPECT_LE(spread_stride(columns), padded(columns) + kLanes);
    EXPECT_EQ(spread_stride(columns) / kLanes % 2, 1) << columns;
    EXPECT_EQ(spread_stride(columns) % kLanes, 0) << columns;
  }
}

}  // namespace
}  // namespace anigen::nn::products
