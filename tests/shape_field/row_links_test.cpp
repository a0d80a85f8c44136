#include "anigen/shape_field/row_links.h"

#include <gtest/gtest.h>

#include "tests/shape_field/mesh_checks.h"

namespace anigen::shape_field {
namespace {

// Six entries of four rows; the second entry belongs to none, the third row has no entries.
RowLinks small_links() {
  return {torch::tensor({0, -1, 3, 0, 1, 3}, torch::kInt64),
          torch::tensor({0, 3, -1, 4, -1, -1, -1, -1, -1, 2, 5, -1}, torch::kInt32).view({4, 3})};
}

TEST(RowLinks, GatherCopiesRowsAndFillsZeros) {
  const Tensor table = torch::arange(8, torch::kFloat32).view({4, 2});
  const Tensor wanted = torch::tensor({0.0f, 1.0f, 0.0f, 0.0f, 6.0f, 7.0f, 0.0f, 1.0f, 2.0f, 3.0f, 6.0f, 7.0f});
  EXPECT_TRUE(torch::equal(gather_rows(table, small_links()), wanted.view({6, 2})));
}

TEST(RowLinks, SumAddsTheEntriesOfARow) {
  const Tensor list = torch::arange(12, torch::kFloat64).view({6, 2});
  const Tensor wanted = torch::tensor({6.0, 8.0, 8.0, 9.0, 0.0, 0.0, 14.0, 16.0}, torch::kFloat64).view({4, 2});
  EXPECT_TRUE(torch::equal(sum_rows(list, small_links()), wanted));
}

TEST(RowLinks, ReadRowsOfAnyStride) {
  torch::manual_seed(1);
  const Tensor wide = torch::randn({3, 2, 7}, torch::kFloat64);
  const Tensor part = wide.slice(2, 2, 4), column = wide.select(2, 5).unsqueeze(2);
  const RowLinks links = small_links();
  EXPECT_TRUE(torch::equal(sum_rows(part, links), sum_rows(part.reshape({6, 2}), links)));
  EXPECT_TRUE(torch::equal(sum_rows(column, links), sum_rows(column.reshape({6, 1}), links)));
  const Tensor table = torch::randn({2, 4}, torch::kFloat64).t();
  EXPECT_TRUE(torch::equal(gather_rows(table, links), gather_rows(table.contiguous(), links)));
}

TEST(RowLinks, AreEachOthersDerivativeTwice) {
  torch::manual_seed(2);
  const RowLinks links = small_links();
  const Tensor a = torch::randn({6, 2}, torch::kFloat64), b = torch::randn({4, 2}, torch::kFloat64);
  const Tensor table = torch::randn({4, 2}, torch::kFloat64).requires_grad_();
  const Tensor loss = (gather_rows(table, links).square() * a).sum();
  const Tensor gradient = torch::autograd::grad({loss}, {table}, {}, /*retain_graph=*/true, /*create_graph=*/true)[0];
  const Tensor wanted = 2.0 * table * sum_rows(a, links);
  EXPECT_TRUE(torch::allclose(gradient, wanted, 1e-12, 1e-12));
  const Tensor second = torch::autograd::grad({(gradient * b).sum()}, {table})[0];
  EXPECT_TRUE(torch::allclose(second, 2.0 * b * sum_rows(a, links), 1e-12, 1e-12));
  const auto sums = [&](const Tensor& list) { return (sum_rows(list, links).pow(3) * b).sum(); };
  EXPECT_LT(test::directional_error(sums, torch::randn({6, 2}, torch::kFloat64), a, 1e-5), 1e-6);
}

TEST(RowLinks, TakeNoChannelsAndNoRows) {
  EXPECT_EQ(gather_rows(torch::zeros({4, 0}), small_links()).size(0), 6);
  const RowLinks none{torch::zeros({0}, torch::kInt64), torch::zeros({0, 3}, torch::kInt32)};
  EXPECT_EQ(sum_rows(torch::zeros({0, 2}), none).size(0), 0);
  EXPECT_ANY_THROW(gather_rows(torch::zeros({3, 2}), small_links())) << "a table with another number of rows";
  EXPECT_ANY_THROW(sum_rows(torch::zeros({6, 2}, torch::kInt64), small_links())) << "integers";
}

}  // namespace
}  // namespace anigen::shape_field
