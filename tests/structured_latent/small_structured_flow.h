#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "anigen/structured_latent/flow.h"
#include "tests/sparse_structure/wave_fill.h"

// The tiny structured-latent flow of docs/reference/flows.md, 7.2, and its batch.
namespace anigen::test {

inline Json tiny_slat_flow_json() {
  return Json::parse(R"({
    "resolution": 6, "in_channels": 8, "in_channels_vert_skin": 8, "in_channels_skl": 4, "out_channels": 8,
    "out_channels_vert_skin": 8, "out_channels_skl": 4, "model_channels": 32, "model_channels_vert_skin": 24,
    "model_channels_skl": 16, "cond_channels": 20, "num_blocks": 2, "num_heads": 2, "num_heads_vert_skin": 2,
    "num_heads_skl": 2, "mlp_ratio": 4, "patch_size": 2, "io_block_channels": [8], "io_block_channels_vert_skin": [6],
    "io_block_channels_skl": [4], "qk_rms_norm": true, "freeze_pretrain_branch": false, "use_joint_num_cond": true})");
}

inline structured_latent::StructuredLatentFlowOptions tiny_slat_flow_options(const Json& changes = Json::object()) {
  Json json = tiny_slat_flow_json();
  json.update(changes);
  return structured_latent::StructuredLatentFlowOptions::from_json(json, "flow.json", "/models/denoiser/args");
}

inline structured_latent::StructuredLatentFlow filled_slat_flow(
    const structured_latent::StructuredLatentFlowOptions& options) {
  structured_latent::StructuredLatentFlow model(options, nn::Init::kNone);
  wave_fill(*model);
  return model;
}

/// Voxels (x, y, z) of a cube of six, in their order, with a·x + b·y + c·z divisible by n; one rule (a, b, c, n) per
/// item.
inline sparse::SupportPtr voxels_by_rule(const std::vector<std::array<std::int64_t, 4>>& rules) {
  std::vector<std::int64_t> rows;
  for (std::size_t item = 0; item < rules.size(); ++item) {
    const auto& [a, b, c, n] = rules[item];
    for (std::int64_t cell = 0; cell < 216; ++cell) {
      const std::int64_t x = cell / 36, y = cell / 6 % 6, z = cell % 6;
      if ((a * x + b * y + c * z) % n == 0) rows.insert(rows.end(), {static_cast<std::int64_t>(item), x, y, z});
    }
  }
  return sparse::Support::create(torch::tensor(rows, torch::kInt64).view({-1, 4}));
}

struct SlatFlowInputs {
  sparse::SparseTensor x{voxels_by_rule({{7, 5, 3, 4}, {3, 2, 7, 5}}), wave({99, 16}, 0.13, 0.0)};
  sparse::SparseTensor x_skl{voxels_by_rule({{1, 2, 5, 7}, {4, 1, 3, 9}}), wave({55, 4}, 0.19, 0.5)};
  torch::Tensor t = torch::tensor({500.0F, 250.0F}), cond = wave({2, 5, 20}, 0.23, 0.7);
  torch::Tensor joints_num = torch::tensor({25, 0});
};

inline structured_latent::StructuredVelocity run_slat_flow(structured_latent::StructuredLatentFlow model,
                                                           const SlatFlowInputs& inputs = {}) {
  const torch::NoGradGuard no_grad;
  return model->forward(inputs.x, inputs.x_skl, inputs.t, inputs.cond, inputs.joints_num);
}

}  // namespace anigen::test
