#pragma once
#include <gtest/gtest.h>

#include <vector>

#include "anigen/nn/state_dict.h"

namespace anigen::test {

/// A model holds bf16 where the published system has fp16, and nowhere else.
/// @tparam Model a module holder with half_precision_modules() and compute_dtype(), set to bf16
template <typename Model>
void expect_bfloat16_torso(Model& model) {
  EXPECT_EQ(model->compute_dtype(), torch::kBFloat16);
  const std::vector<torch::Dtype> published = nn::published_dtypes(*model, model->half_precision_modules());
  const std::vector<nn::StateEntry> entries = nn::state_entries(*model);
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const torch::Dtype wanted = published[i] == torch::kHalf ? torch::kBFloat16 : torch::kFloat32;
    EXPECT_EQ(entries[i].tensor.scalar_type(), wanted) << entries[i].key;
  }
}

}  // namespace anigen::test
