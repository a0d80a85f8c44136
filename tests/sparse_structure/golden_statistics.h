#pragma once
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::test {

/// First four values, last two, sum, sum of squares against those of docs/reference/flows.md, 7.2, with its own
/// tolerance.
inline void expect_statistics(const torch::Tensor& output, const std::vector<double>& golden) {
  const torch::Tensor values = output.to(torch::kFloat64).flatten();
  const auto count = values.size(0);
  std::vector<double> found;
  for (const std::int64_t i :
       {std::int64_t{0}, std::int64_t{1}, std::int64_t{2}, std::int64_t{3}, count - 2, count - 1})
    found.push_back(values[i].item<double>());
  found.push_back(values.sum().item<double>());
  found.push_back(values.square().sum().item<double>());
  ASSERT_EQ(found.size(), golden.size());
  for (std::size_t i = 0; i < golden.size(); ++i)
    EXPECT_NEAR(found[i], golden[i], 1e-6 + 1e-5 * std::abs(golden[i])) << "statistic " << i;
}

}  // namespace anigen::test
