#pragma once
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <tuple>
#include <vector>

#include "anigen/nn/embeddings.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/encoder.h"

// Structured-latent models of a few channels, and batches for them.
namespace anigen::test {

inline Json small_slat_encoder_json() {
  return Json::parse(R"({
    "resolution": 8, "in_channels": 5, "model_channels": 12, "model_channels_skl": 16, "model_channels_skin": 10,
    "latent_channels": 3, "latent_channels_skl": 2, "latent_channels_vertskin": 4, "num_blocks": 2, "num_heads": 2,
    "num_heads_skl": 2, "num_heads_skin": 2, "skl_pos_embed_freq": 3, "mlp_ratio": 2, "window_size": 4,
    "attn_mode_cross": "swin", "skin_cross_from_geo": false, "skl_cross_from_geo": false, "skin_skl_cross": false,
    "jp_residual_fields": true, "jp_hyper_continuous": true, "use_pretrain_branch": false,
    "skin_encoder_config": {"skin_feat_channels": 3, "skl_pos_embed_freq": 4, "jp_embed_dim": 8,
                            "jp_embedder_config": {"hidden_dim": 8, "depth": 1}}})");
}

inline Json small_slat_decoder_json() {
  return Json::parse(R"({
    "resolution": 8, "model_channels": 256, "model_channels_skl": 32, "model_channels_skin": 32,
    "latent_channels": 3, "latent_channels_skl": 2, "latent_channels_vertskin": 4, "num_blocks": 2, "num_heads": 2,
    "num_heads_skl": 2, "num_heads_skin": 2, "mlp_ratio": 0.25, "window_size": 4, "attn_mode_cross": "swin",
    "h_skin_unet_num_levels": -1, "use_pretrain_branch": false,
    "representation_config": {"use_color": true, "use_conf_jp": true},
    "skin_decoder_config": {"skin_feat_channels": 3, "model_channels": 8, "num_blocks": 2, "num_heads": 2}})");
}

inline structured_latent::StructuredLatentEncoder small_slat_encoder(const Json& json) {
  return structured_latent::StructuredLatentEncoder(structured_latent::StructuredLatentEncoderOptions::from_json(json));
}

inline structured_latent::StructuredLatentDecoder small_slat_decoder(const Json& json) {
  return structured_latent::StructuredLatentDecoder(structured_latent::StructuredLatentDecoderOptions::from_json(json));
}

/// As many voxels per asset as `counts` says, drawn from the grid, in its order.
inline sparse::SupportPtr drawn_voxels(const std::vector<std::int64_t>& counts, std::int64_t resolution = 8) {
  std::vector<torch::Tensor> rows;
  const torch::Tensor grid = nn::grid_coordinates(resolution);
  for (std::size_t item = 0; item < counts.size(); ++item) {
    const torch::Tensor drawn = std::get<0>(torch::randperm(grid.size(0)).slice(0, 0, counts[item]).sort());
    const torch::Tensor index = torch::full({counts[item], 1}, static_cast<std::int64_t>(item), torch::kInt64);
    rows.push_back(torch::cat({index, grid.index_select(0, drawn)}, 1));
  }
  return sparse::Support::create(torch::cat(rows, 0), static_cast<std::int64_t>(counts.size()));
}

/// A tetrahedron and a chain of joints per asset.
inline structured_latent::RiggedMeshes small_rigs(const std::vector<std::int64_t>& joints) {
  structured_latent::RiggedMeshes rigs;
  for (const std::int64_t count : joints) {
    rigs.joints.push_back(torch::rand({count, 3}) - 0.5);
    rigs.parents.push_back(torch::arange(-1, count - 1));
    rigs.skin.push_back(torch::softmax(2.0 * torch::randn({4, count}), 1));
    rigs.vertices.push_back(
        torch::tensor({-0.4F, -0.4F, -0.4F, 0.4F, -0.4F, -0.3F, 0.0F, 0.4F, -0.4F, 0.0F, 0.1F, 0.4F}).view({4, 3}));
    rigs.faces.push_back(torch::tensor({0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3}, torch::kInt64).view({4, 3}));
  }
  return rigs;
}

inline std::vector<skeleton_field::SkeletonTensors> skeletons_of(const structured_latent::RiggedMeshes& rigs) {
  std::vector<skeleton_field::SkeletonTensors> skeletons;
  for (std::size_t i = 0; i < rigs.joints.size(); ++i) skeletons.push_back({rigs.joints[i], rigs.parents[i]});
  return skeletons;
}

/// Moves parameters away from initial values that hide things: zeros, output layers of 1e-4.
inline void stir(torch::nn::Module& model, double size = 0.1) {
  const torch::NoGradGuard no_grad;
  for (torch::Tensor& parameter : model.parameters()) parameter.add_(size * torch::randn_like(parameter));
}

/// Compares the gradient of `loss`, along one random direction over all parameters, with a central difference. The
/// parameters are in double precision. The difference is exact to h² times the third derivative.
template <typename Loss>
void expect_gradient_of(std::vector<torch::Tensor> parameters, const Loss& loss, double tolerance) {
  for (torch::Tensor& parameter : parameters) parameter.mutable_grad() = torch::Tensor();
  loss().backward();
  const torch::NoGradGuard no_grad;
  const double h = 1e-5;
  double predicted = 0.0;
  std::vector<torch::Tensor> steps;
  for (const torch::Tensor& parameter : parameters) {
    steps.push_back(torch::randn_like(parameter) / std::sqrt(static_cast<double>(parameter.numel())));
    if (parameter.grad().defined()) predicted += (parameter.grad() * steps.back()).sum().template item<double>();
  }
  const auto move = [&](double factor) {
    for (std::size_t p = 0; p < steps.size(); ++p) parameters[p].add_(steps[p], factor);
  };
  move(h);
  double slope = loss().template item<double>();
  move(-2.0 * h);
  slope = (slope - loss().template item<double>()) / (2.0 * h);
  move(h);
  EXPECT_NEAR(predicted, slope, tolerance * (1.0 + std::abs(slope)));
}

}  // namespace anigen::test
