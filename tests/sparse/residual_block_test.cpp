#include "anigen/sparse/residual_block.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "anigen/nn/init.h"
#include "anigen/sparse/resampling.h"
#include "tests/sparse/attention_cases.h"

namespace anigen::sparse {
namespace {

constexpr double kResidualTolerance = 1e-11;  // fp64 throughout, values of some tens

ResidualBlock random_residual_block(std::int64_t in, std::int64_t out, std::int64_t embedding) {
  ResidualBlock block(ResidualBlockOptions{in, out, embedding});
  cases::draw_parameters(*block, torch::kFloat64);
  return block;
}

// Every voxel of a cube, for each item.
SupportPtr full_grid(std::int64_t side, std::int64_t items) {
  return Support::create(torch::ones({items, side, side, side}).nonzero());
}

Tensor channels_norm(const Tensor& x) { return torch::layer_norm(x, {x.size(-1)}, {}, {}, 1e-6); }

// The block on a full grid, from dense operators. x [B, S, S, S, C]
Tensor dense_residual_block(const ResidualBlock& block, const Tensor& x, const Tensor& embedding) {
  const auto p = block->named_parameters();
  const auto convolved = [&](const Tensor& rows, const std::string& name) {
    const Tensor weight = p[name + ".conv.weight"].permute({0, 4, 1, 2, 3});
    return torch::conv3d(rows.permute({0, 4, 1, 2, 3}), weight, p[name + ".conv.bias"], 1, 1).permute({0, 2, 3, 4, 1});
  };
  const Tensor values = torch::linear(torch::silu(embedding), p["emb_layers.1.weight"], p["emb_layers.1.bias"]);
  const std::vector<Tensor> parts = values.view({x.size(0), 1, 1, 1, -1}).chunk(2, -1);  // scale, then shift
  Tensor h = torch::silu(channels_norm(x) * p["norm1.weight"] + p["norm1.bias"]);
  h = convolved(h, "conv1");
  h = convolved(torch::silu(channels_norm(h) * (1.0 + parts[0]) + parts[1]), "conv2");
  const Tensor* skip = p.find("skip_connection.weight");
  return h + (skip == nullptr ? x : torch::linear(x, *skip, p["skip_connection.bias"]));
}

TEST(SparseResidualBlock, KeysInPublishedOrder) {
  const std::vector<std::string> same = {"norm1.weight",        "norm1.bias",        "conv1.conv.weight",
                                         "conv1.conv.bias",     "conv2.conv.weight", "conv2.conv.bias",
                                         "emb_layers.1.weight", "emb_layers.1.bias"};
  std::vector<std::string> wider = same;
  wider.insert(wider.end(), {"skip_connection.weight", "skip_connection.bias"});
  EXPECT_EQ(cases::parameter_keys(*ResidualBlock(ResidualBlockOptions{4, 4, 3})), same);
  EXPECT_EQ(cases::parameter_keys(*ResidualBlock(ResidualBlockOptions{4, 5, 3})), wider);
}

TEST(SparseResidualBlock, EqualsDenseOperatorsOnAFullGrid) {
  torch::manual_seed(5);
  constexpr std::int64_t kSide = 4, kItems = 2;
  const SupportPtr support = full_grid(kSide, kItems);
  const Tensor feats = torch::randn({support->size(), 6}, torch::kFloat64);
  const Tensor embedding = torch::randn({kItems, 5}, torch::kFloat64);
  for (const std::int64_t out : {6, 4}) {
    ResidualBlock block = random_residual_block(6, out, 5);
    const Tensor expected = dense_residual_block(block, feats.view({kItems, kSide, kSide, kSide, 6}), embedding);
    const Tensor found = block->forward({support, feats}, embedding).feats;
    EXPECT_LT(cases::distance(found, expected.reshape({-1, out})), kResidualTolerance) << out;
  }
}

TEST(SparseResidualBlock, GoingUpEqualsUpsamplingFirst) {
  torch::manual_seed(6);
  const SupportPtr fine = Support::create(cases::random_voxels({70, 40}, 6));
  const SparseTensor coarse{fine->coarsened(2).support,
                            torch::randn({fine->coarsened(2).support->size(), 6}, torch::kFloat64)};
  const Tensor embedding = torch::randn({2, 5}, torch::kFloat64);
  for (const std::int64_t out : {6, 4}) {
    ResidualBlock block = random_residual_block(6, out, 5);
    const SparseTensor up = block->forward_up(coarse, fine, embedding);
    EXPECT_EQ(up.support, fine);
    const Tensor expected = block->forward(upsample(coarse, fine, 2), embedding).feats;
    EXPECT_LT(cases::distance(up.feats, expected), kResidualTolerance) << out;
  }
}

TEST(SparseResidualBlock, FreshBlockIsItsSkip) {
  torch::manual_seed(7);
  ResidualBlock block(ResidualBlockOptions{4, 4, 3});
  nn::xavier_uniform_linears(*block);
  nn::default_norms(*block);
  default_submanifold_kernels(*block);
  block->initialize();
  const SparseTensor x{full_grid(3, 1), torch::randn({27, 4})};
  EXPECT_TRUE(torch::equal(block->forward(x, torch::randn({1, 3})).feats, x.feats));
}

}  // namespace
}  // namespace anigen::sparse
