#pragma once
#include <gtest/gtest.h>

#include <cstddef>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::test {

/// Result of an attention, and the gradients with respect to queries, keys and values.
struct AttentionResults {
  torch::Tensor out;
  std::vector<torch::Tensor> gradients;
};

/// Largest difference as a share of one plus the largest wanted value (a gradient may vanish); 0 for no values.
inline double share_of_difference(const torch::Tensor& found, const torch::Tensor& wanted) {
  if (wanted.numel() == 0) return 0.0;
  const torch::Tensor exact = wanted.to(torch::kFloat64);
  return ((found.to(torch::kFloat64) - exact).abs().max() / (1.0 + exact.abs().max())).item<double>();
}

inline void expect_close(const AttentionResults& found, const AttentionResults& wanted, double limit) {
  ASSERT_EQ(found.out.sizes(), wanted.out.sizes());
  EXPECT_LT(share_of_difference(found.out, wanted.out), limit) << "output";
  const char* names[] = {"dq", "dk", "dv"};
  for (std::size_t i = 0; i < 3; ++i) {
    ASSERT_EQ(found.gradients[i].sizes(), wanted.gradients[i].sizes()) << names[i];
    EXPECT_LT(share_of_difference(found.gradients[i], wanted.gradients[i]), limit) << names[i];
  }
}

}  // namespace anigen::test
