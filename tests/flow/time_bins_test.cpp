#include "anigen/flow/time_bins.h"

#include <gtest/gtest.h>

namespace anigen::flow {
namespace {

TEST(TimeBins, ItemsOfVoxelsHaveMeansOfTheirOwn) {
  const Tensor rows = torch::tensor({{1.0, 3.0}, {5.0, 7.0}, {10.0, 20.0}});
  const Tensor item = torch::tensor({0, 0, 2}, torch::kInt64);
  const Tensor means = mean_per_item(rows, item, 4);
  EXPECT_TRUE(torch::equal(means, torch::tensor({4.0, 0.0, 15.0, 0.0})))
      << means << "over rows and channels; nothing for items without rows";
}

}  // namespace
}  // namespace anigen::flow
