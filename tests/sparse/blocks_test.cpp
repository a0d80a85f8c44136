#include <gtest/gtest.h>
#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/blocks.h"
#include "anigen/nn/init.h"
#include "anigen/sparse/blocks.h"
#include "tests/sparse/attention_cases.h"

namespace anigen::sparse {

namespace {

TEST(Resampling, CoarseFeaturesCountTheZeroTheyStartFrom) {
  torch::manual_seed(31);
  const SparseTensor x = cases::random_sparse({60, 0, 40}, 6, 3, torch::kFloat64);
  const SparseTensor coarse = downsample(x, 2);
  const Tensor row = x.support->coarsened(2).row.host();
  for (std::int64_t c = 0; c < coarse.support->size(); ++c) {
    const Tensor members = x.feats.index_select(0, row.eq(c).nonzero().squeeze(1));
    EXPECT_LT(cases::distance(coarse.feats[c], members.sum(0) / static_cast<double>(members.size(0) + 1)), 1e-12);
  }
  const SparseTensor back = upsample(coarse, x.support, 2);
  EXPECT_EQ(back.support, x.support);
  EXPECT_TRUE(torch::equal(back.feats, coarse.feats.index_select(0, row)));
}

TEST(Resampling, GradientsMatchFiniteDifferences) {
  torch::manual_seed(32);
  const SparseTensor x = cases::random_sparse({30, 20}, 4, 2, torch::kFloat64);
  const Tensor direction = torch::randn_like(subdivide(x).feats), step = torch::randn_like(x.feats);
  const auto loss = [&](const Tensor& feats) {
    const SparseTensor up = upsample(downsample(x.with(feats.sin()), 3), x.support, 3);
    return (subdivide(up).feats * direction).sum();
  };
  const Tensor feats = x.feats.clone().requires_grad_();
  const double found = (torch::autograd::grad({loss(feats)}, {feats})[0] * step).sum().item<double>();
  const double h = 1e-5;  // error of the central difference ~ h² third derivative, of rounding ~ 1e-14 / h
  const double slope = (loss(x.feats + h * step) - loss(x.feats - h * step)).item<double>() / (2 * h);
  EXPECT_NEAR(found, slope, 1e-6 * (1.0 + std::abs(slope)));
}

// One voxel at a time: members of each coarse place in a map, which is sorted as the rows shall be.
TEST(Resampling, AFactorPerAxisAgreesWithOneVoxelAtATime) {
  torch::manual_seed(35);
  const SparseTensor x = cases::random_sparse({70, 0, 45}, 9, 3, torch::kFloat64);
  const std::int64_t rows = x.support->size();
  const Tensor coords = x.support->coords().to(torch::kInt64);
  for (const GridFactor& factor :
       {GridFactor(1, 2, 4), GridFactor(4, 1, 2), GridFactor(1, 1, 3), GridFactor(2, 2, 2)}) {
    std::map<std::vector<std::int64_t>, std::vector<std::int64_t>> members;  // item, x, y, z → fine rows
    for (std::int64_t row = 0; row < rows; ++row) {
      std::vector<std::int64_t> place{coords[row][0].item<std::int64_t>()};
      for (std::size_t axis = 0; axis < 3; ++axis)
        place.push_back(coords[row][static_cast<std::int64_t>(axis) + 1].item<std::int64_t>() / factor.axes[axis]);
      members[place].push_back(row);
    }
    const Tensor feats = x.feats.clone().requires_grad_();
    const SparseTensor coarse = downsample(x.with(feats), factor), back = upsample(coarse, x.support, factor);
    const Tensor direction = torch::randn_like(coarse.feats), back_direction = torch::randn_like(back.feats);
    const Tensor down_slope = torch::autograd::grad({coarse.feats}, {feats}, {direction}, /*retain_graph=*/true)[0];
    const Tensor up_slope = torch::autograd::grad({back.feats}, {feats}, {back_direction})[0];
    ASSERT_EQ(coarse.support->size(), static_cast<std::int64_t>(members.size()));
    std::int64_t at = 0;
    for (const auto& [place, fine] : members) {
      EXPECT_TRUE(torch::equal(coarse.support->coords()[at].to(torch::kInt64), torch::tensor(place, torch::kInt64)));
      const double share = 1.0 / static_cast<double>(fine.size() + 1);
      Tensor sum = torch::zeros({3}, torch::kFloat64), slopes = torch::zeros({3}, torch::kFloat64);
      for (const std::int64_t row : fine) {
        sum += x.feats[row];
        slopes += back_direction[row];
      }
      EXPECT_LT(cases::distance(coarse.feats[at].detach(), sum * share), 1e-12);
      for (const std::int64_t row : fine) {
        EXPECT_LT(cases::distance(back.feats[row].detach(), sum * share), 1e-12);
        EXPECT_LT(cases::distance(down_slope[row], direction[at] * share), 1e-12);
        EXPECT_LT(cases::distance(up_slope[row], slopes * share), 1e-12);
      }
      ++at;
    }
  }
}

TEST(Resampling, OneFactorStandsForThree) {
  torch::manual_seed(36);
  const SparseTensor x = cases::random_sparse({60, 40}, 7, 3);
  EXPECT_TRUE(torch::equal(downsample(x, 2).feats, downsample(x, {2, 2, 2}).feats));
  EXPECT_FALSE(downsample(x, 2).support->size() == downsample(x, {1, 2, 2}).support->size());
  EXPECT_THROW(downsample(x, {2, 0, 2}), InputError);
  EXPECT_THROW(upsample(downsample(x, {1, 2, 2}), x.support, 2), c10::Error);
}

TEST(Resampling, ChildrenRepeatTheirVoxel) {
  torch::manual_seed(33);
  const SparseTensor x = cases::random_sparse({20}, 4, 5), fine = subdivide(x);
  EXPECT_EQ(fine.support, x.support->subdivided());
  EXPECT_TRUE(torch::equal(fine.feats, x.feats.repeat_interleave(8, 0)));
}

TEST(Resampling, SixteenBitSumsDoNotLoseMembers) {
  // 512 ones: a 16-bit sum would stop growing at 256.
  const Tensor cells = torch::arange(512);
  const Tensor x = torch::floor_divide(cells, 64), y = torch::floor_divide(cells, 8).remainder(8),
               z = cells.remainder(8);
  const SupportPtr support = Support::create(torch::stack({torch::zeros_like(x), x, y, z}, 1));
  const SparseTensor coarse = downsample({support, torch::ones({512, 1}, torch::kBFloat16)}, 8);
  EXPECT_EQ(coarse.feats.scalar_type(), torch::kBFloat16);
  EXPECT_NEAR(coarse.feats.item<double>(), 512.0 / 513.0, 0.004);  // one unit in the last place
}

TEST(Resampling, UpsamplingNeedsTheCoarserVoxels) {
  torch::manual_seed(34);
  const SparseTensor x = cases::random_sparse({40}, 6, 3), other = cases::random_sparse({40}, 6, 3);
  EXPECT_THROW(upsample(downsample(other, 2), x.support, 2), c10::Error);
  // Another support with the same voxels will do.
  const SparseTensor same{Support::create(x.support->coords()), x.feats};
  EXPECT_EQ(upsample(downsample(same, 2), x.support, 2).support, x.support);
}

TEST(Resampling, NoVoxels) {
  const SparseTensor x{Support::create(torch::zeros({0, 4}, torch::kInt32), 1), torch::zeros({0, 3})};
  EXPECT_EQ(downsample(x, 2).feats.sizes(), (std::vector<std::int64_t>{0, 3}));
  EXPECT_EQ(subdivide(x).feats.sizes(), (std::vector<std::int64_t>{0, 3}));
}

}  // namespace

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

namespace {

using Keys = std::vector<std::string>;

constexpr double kDoubleTolerance = 1e-11;  // fp64 throughout, values of some tens

Keys with_parts(const std::string& layer, const Keys& parts) {
  Keys keys;
  for (const std::string& part : parts) keys.push_back(layer + "." + part);
  return keys;
}

Keys joined(const std::vector<Keys>& lists) {
  Keys keys;
  for (const Keys& list : lists) keys.insert(keys.end(), list.begin(), list.end());
  return keys;
}

const Keys kNormKeys{"weight", "bias"};
const Keys kSelfKeys{"to_qkv.weight", "to_qkv.bias", "to_out.weight", "to_out.bias"};
const Keys kCrossKeys{"to_q.weight", "to_q.bias", "to_kv.weight", "to_kv.bias", "to_out.weight", "to_out.bias"};
const Keys kMlpKeys{"mlp.mlp.0.weight", "mlp.mlp.0.bias", "mlp.mlp.2.weight", "mlp.mlp.2.bias"};

SparseBlockOptions sparse_block_of(std::int64_t channels) {
  SparseBlockOptions options;
  options.channels = channels;
  options.num_heads = 2;
  options.mlp_ratio = 2.0;
  return options;
}

SparseModulatedBlockOptions sparse_modulated_of(std::int64_t channels) {
  SparseModulatedBlockOptions options;
  options.channels = channels;
  options.context_channels = 6;
  options.num_heads = 2;
  options.mlp_ratio = 2.0;
  options.qk_rms_norm = true;
  return options;
}

nn::ModulatedBlockOptions dense_modulated_of(const SparseModulatedBlockOptions& sparse) {
  nn::ModulatedBlockOptions options;
  options.channels = sparse.channels;
  options.context_channels = sparse.context_channels;
  options.num_heads = sparse.num_heads;
  options.mlp_ratio = sparse.mlp_ratio;
  options.qk_rms_norm = sparse.qk_rms_norm;
  options.qk_rms_norm_cross = sparse.qk_rms_norm_cross;
  options.share_mod = sparse.share_mod;
  options.context_norm = sparse.context_norm;
  return options;
}

// Items of equal length as a dense batch.
Tensor as_batch(const SparseTensor& x) { return x.feats.view({x.support->items().items(), -1, x.channels()}); }

Tensor random_doubles(std::vector<std::int64_t> shape) { return torch::randn(shape, torch::kFloat64); }

TEST(SparseTransformerBlock, KeysInPublishedOrder) {
  SparseBlockOptions options = sparse_block_of(8);
  EXPECT_EQ(cases::parameter_keys(*SparseTransformerBlock(options)), joined({with_parts("attn", kSelfKeys), kMlpKeys}));
  options.affine_norms = true;
  options.attention_name = "self_attn";
  EXPECT_EQ(cases::parameter_keys(*SparseTransformerBlock(options)),
            joined({with_parts("norm1", kNormKeys), with_parts("norm2", kNormKeys), with_parts("self_attn", kSelfKeys),
                    kMlpKeys}));
}

TEST(SparseTransformerBlock, FullAttentionIsTheDenseBlockOnEachItem) {
  torch::manual_seed(61);
  SparseBlockOptions options = sparse_block_of(8);
  options.affine_norms = options.qk_rms_norm = true;
  SparseTransformerBlock block(options);
  cases::draw_parameters(*block, torch::kFloat64);
  nn::DenseBlockOptions dense_options;
  dense_options.channels = 8;
  dense_options.num_heads = 2;
  dense_options.mlp_ratio = 2.0;
  dense_options.qk_rms_norm = dense_options.affine_norms = true;
  nn::DenseBlock dense(dense_options);
  dense->to(torch::kFloat64);
  cases::copy_parameters(*block, *dense);
  const SparseTensor x = cases::random_sparse({11, 11}, 6, 8, torch::kFloat64);
  EXPECT_LT(cases::distance(as_batch(block->forward(x)), dense->forward(as_batch(x))), kDoubleTolerance);
}

TEST(SparseTransformerBlock, ABatchIsItsItems) {
  torch::manual_seed(62);
  for (const bool windowed : {false, true}) {
    SparseBlockOptions options = sparse_block_of(8);
    options.scope = AttentionScope::of(windowed ? "swin" : "full", 4, 2);
    SparseTransformerBlock block(options);
    cases::draw_parameters(*block, torch::kFloat64);
    const Tensor first = cases::random_voxels({30}, 7), second = cases::random_voxels({9}, 7);
    const Tensor moved = second + torch::tensor({1, 0, 0, 0}, torch::kInt32);
    const Tensor feats = random_doubles({39, 8});
    const Tensor found = block->forward({Support::create(torch::cat({first, moved}, 0)), feats}).feats;
    const Tensor one = block->forward({Support::create(first), feats.narrow(0, 0, 30)}).feats;
    const Tensor two = block->forward({Support::create(second), feats.narrow(0, 30, 9)}).feats;
    EXPECT_LT(cases::distance(found, torch::cat({one, two}, 0)), kDoubleTolerance) << windowed;
  }
}

TEST(SparseCrossBlock, IsTheDenseCrossBlockOnEachItem) {
  torch::manual_seed(63);
  SparseBlockOptions options = sparse_block_of(8);
  options.context_channels = {5};
  options.affine_norms = true;
  SparseCrossBlock block(options);
  cases::draw_parameters(*block, torch::kFloat64);
  nn::DenseBlockOptions dense_options;
  dense_options.channels = 8;
  dense_options.context_channels = 5;
  dense_options.num_heads = 2;
  dense_options.mlp_ratio = 2.0;
  dense_options.affine_norms = true;
  nn::DenseCrossBlock dense(dense_options);
  dense->to(torch::kFloat64);
  EXPECT_EQ(cases::parameter_keys(*block), cases::parameter_keys(*dense));
  cases::copy_parameters(*block, *dense);
  const SparseTensor x = cases::random_sparse({10, 10}, 6, 8, torch::kFloat64);
  const SparseTensor context = cases::random_sparse({4, 4}, 6, 5, torch::kFloat64);
  const Tensor wanted = dense->forward(as_batch(x), as_batch(context));
  EXPECT_LT(cases::distance(as_batch(block->forward(x, context)), wanted), kDoubleTolerance);
}

TEST(SparseCrossBlock, NormOfTheContext) {
  SparseBlockOptions options = sparse_block_of(8);
  options.context_channels = {5};
  options.affine_norms = options.norm_context = true;
  EXPECT_EQ(cases::parameter_keys(*SparseCrossBlock(options)),
            joined({with_parts("norm1", kNormKeys), with_parts("norm2", kNormKeys), with_parts("norm3", kNormKeys),
                    with_parts("norm4", kNormKeys), with_parts("self_attn", kSelfKeys),
                    with_parts("cross_attn", kCrossKeys), kMlpKeys}));
  options.affine_norms = false;
  torch::manual_seed(64);
  SparseCrossBlock block(options);
  cases::draw_parameters(*block, torch::kFloat64);
  const SparseTensor x = cases::random_sparse({10}, 6, 8, torch::kFloat64);
  const SparseTensor context = cases::random_sparse({7}, 6, 5, torch::kFloat64);
  // A change that a layer norm without parameters does not see; its eps of 1e-6 beside variances of size one does.
  const SparseTensor scaled = context.with(context.feats * 3.0 + 2.0);
  EXPECT_LT(cases::distance(block->forward(x, scaled).feats, block->forward(x, context).feats), 1e-4);
  options.context_channels = {5, 5};
  EXPECT_THROW(SparseCrossBlock{options}, c10::Error);
}

TEST(SparseMultiContextBlock, KeysInPublishedOrder) {
  SparseBlockOptions options = sparse_block_of(8);
  EXPECT_EQ(cases::parameter_keys(*SparseMultiContextBlock(options)),
            joined({with_parts("self_attn", kSelfKeys), kMlpKeys}));
  options.context_channels = {5, 7};
  EXPECT_EQ(cases::parameter_keys(*SparseMultiContextBlock(options)),
            joined({with_parts("norm2", kNormKeys), with_parts("self_attn", kSelfKeys),
                    with_parts("cross_attn_0", kCrossKeys), with_parts("ctx_norm_0", kNormKeys),
                    with_parts("cross_attn_1", kCrossKeys), with_parts("ctx_norm_1", kNormKeys), kMlpKeys}));
}

TEST(SparseMultiContextBlock, WithoutContextsIsThePlainBlock) {
  torch::manual_seed(65);
  SparseBlockOptions options = sparse_block_of(8);
  options.attention_name = "self_attn";
  SparseTransformerBlock plain(options);
  SparseMultiContextBlock multi(options);
  cases::draw_parameters(*plain, torch::kFloat64);
  multi->to(torch::kFloat64);
  cases::copy_parameters(*plain, *multi);
  const SparseTensor x = cases::random_sparse({12, 5}, 6, 8, torch::kFloat64);
  EXPECT_TRUE(torch::equal(multi->forward(x, {}).feats, plain->forward(x).feats));
  EXPECT_THROW(multi->forward(x, {x}), c10::Error);
}

// The queries of all contexts are the same norm of x as it was before the first context.
TEST(SparseMultiContextBlock, ContextsAddUpIndependently) {
  torch::manual_seed(66);
  SparseBlockOptions options = sparse_block_of(8);
  options.context_channels = {5, 7};
  SparseMultiContextBlock block(options);
  cases::draw_parameters(*block, torch::kFloat64);
  const SparseTensor x = cases::random_sparse({12, 5}, 6, 8, torch::kFloat64);
  const SparseTensor a = cases::random_sparse({4, 9}, 6, 5, torch::kFloat64);
  const SparseTensor b = cases::random_sparse({6, 3}, 6, 7, torch::kFloat64);
  auto parameters = block->named_parameters();
  const auto without_mlp = [&](const std::string& silent) {
    const torch::NoGradGuard no_grad;
    std::vector<std::pair<Tensor, Tensor>> kept;
    for (const std::string& key : {std::string("mlp.mlp.2"), silent}) {
      if (key.empty()) continue;
      for (const char* part : {".weight", ".bias"}) {
        Tensor& parameter = parameters[key + part];
        kept.emplace_back(parameter, parameter.clone());
        parameter.zero_();
      }
    }
    const Tensor found = block->forward(x, {a, b}).feats;
    for (auto& [parameter, value] : kept) parameter.copy_(value);
    return found;
  };
  const Tensor both = without_mlp(""), first = without_mlp("cross_attn_1.to_out");
  const Tensor second = without_mlp("cross_attn_0.to_out");
  parameters["cross_attn_0.to_out.weight"].data().zero_();
  parameters["cross_attn_0.to_out.bias"].data().zero_();
  const Tensor neither = without_mlp("cross_attn_1.to_out");
  EXPECT_LT(cases::distance(both - neither, (first - neither) + (second - neither)), kDoubleTolerance);
  EXPECT_GT(cases::distance(first, neither), 1e-3);
  EXPECT_GT(cases::distance(second, neither), 1e-3);
}

TEST(SparseModulatedBlock, IsTheDenseBlockOnEachItem) {
  torch::manual_seed(67);
  for (const bool share : {false, true}) {
    SparseModulatedBlockOptions options = sparse_modulated_of(8);
    options.share_mod = share;
    SparseModulatedBlock block(options);
    cases::draw_parameters(*block, torch::kFloat64);
    nn::ModulatedBlock dense(dense_modulated_of(options));
    dense->to(torch::kFloat64);
    EXPECT_EQ(cases::parameter_keys(*block), cases::parameter_keys(*dense));
    EXPECT_EQ(block->modulation().is_empty(), share);
    cases::copy_parameters(*block, *dense);
    const SparseTensor x = cases::random_sparse({9, 9, 9}, 6, 8, torch::kFloat64);
    const Tensor mod = random_doubles({3, share ? 48 : 8});
    EXPECT_LT(cases::distance(as_batch(block->forward(x, mod)), dense->forward(as_batch(x), mod)), kDoubleTolerance);
    EXPECT_THROW(block->forward(x, mod.narrow(0, 0, 2)), c10::Error);
    if (share) {
      EXPECT_THROW(block->forward(x, mod.narrow(1, 0, 8)), c10::Error);
    }
  }
}

// Dense and sparse contexts with the same rows, and the gradients of x, modulation and context.
TEST(SparseModulatedCrossBlock, IsTheDenseBlockOnEachItem) {
  torch::manual_seed(68);
  SparseModulatedBlockOptions options = sparse_modulated_of(8);
  options.context_norm = options.qk_rms_norm_cross = true;
  SparseModulatedCrossBlock block(options);
  cases::draw_parameters(*block, torch::kFloat64);
  nn::ModulatedCrossBlock dense(dense_modulated_of(options));
  dense->to(torch::kFloat64);
  EXPECT_EQ(cases::parameter_keys(*block), cases::parameter_keys(*dense));
  cases::copy_parameters(*block, *dense);
  SparseTensor x = cases::random_sparse({9, 9}, 6, 8, torch::kFloat64);
  const SparseTensor context = cases::random_sparse({5, 5}, 6, 6, torch::kFloat64);
  const Tensor mod = random_doubles({2, 8}).requires_grad_();
  x.feats.requires_grad_();
  context.feats.requires_grad_();
  const std::vector<Tensor> inputs{x.feats, mod, context.feats};
  const Tensor wanted = dense->forward(as_batch(x), mod, as_batch(context));
  const Tensor direction = random_doubles({2, 9, 8});
  const auto wanted_gradients = torch::autograd::grad({wanted}, inputs, {direction});
  for (const bool sparse_context : {false, true}) {
    const Tensor found =
        as_batch(sparse_context ? block->forward(x, mod, context) : block->forward_dense(x, mod, as_batch(context)));
    EXPECT_LT(cases::distance(found, wanted), kDoubleTolerance) << sparse_context;
    const auto gradients = torch::autograd::grad({found}, inputs, {direction});
    for (std::size_t i = 0; i < inputs.size(); ++i)
      EXPECT_LT(cases::distance(gradients[i], wanted_gradients[i]), 1e-10) << sparse_context << " " << i;
  }
}

TEST(SparseModulatedCrossBlock, ItemsOfDifferentLengthAndNone) {
  torch::manual_seed(69);
  SparseModulatedCrossBlock block(sparse_modulated_of(8));
  cases::draw_parameters(*block, torch::kFloat64);
  const Tensor first = cases::random_voxels({20}, 6), last = cases::random_voxels({3}, 6);
  const Tensor moved = last + torch::tensor({2, 0, 0, 0}, torch::kInt32);
  const Tensor feats = random_doubles({23, 8}), mod = random_doubles({3, 8}), context = random_doubles({3, 4, 6});
  const SparseTensor batch{Support::create(torch::cat({first, moved}, 0)), feats};  // item 1 is empty
  const Tensor found = block->forward_dense(batch, mod, context).feats;
  const auto alone = [&](const Tensor& coords, std::int64_t row, std::int64_t item) {
    const SparseTensor x{Support::create(coords), feats.narrow(0, row, coords.size(0))};
    return block->forward_dense(x, mod.narrow(0, item, 1), context.narrow(0, item, 1)).feats;
  };
  EXPECT_LT(cases::distance(found, torch::cat({alone(first, 0, 0), alone(last, 20, 2)}, 0)), kDoubleTolerance);
}

DualStreamBlockOptions dual_options() {
  DualStreamBlockOptions options;
  options.channels = 8;
  options.channels_skl = 6;
  options.num_heads = 2;
  options.num_heads_skl = 3;
  options.context_channels = 5;
  options.mlp_ratio = 2.0;
  return options;
}

TEST(DualStreamBlock, KeysInPublishedOrder) {
  const Keys linear{"1.weight", "1.bias"};
  const Keys skeleton_mlp{"mlp_skl.mlp.0.weight", "mlp_skl.mlp.0.bias", "mlp_skl.mlp.2.weight", "mlp_skl.mlp.2.bias"};
  EXPECT_EQ(cases::parameter_keys(*DualStreamBlock(dual_options())),
            joined({with_parts("norm2", kNormKeys), with_parts("norm2_skl", kNormKeys), with_parts("attn", kCrossKeys),
                    with_parts("attn_skl", kCrossKeys), with_parts("context_cross_attn", kCrossKeys),
                    with_parts("context_cross_attn_skl", kCrossKeys), kMlpKeys, skeleton_mlp,
                    with_parts("adaLN_modulation", linear), with_parts("adaLN_modulation_skl", linear)}));
}

TEST(DualStreamBlock, ZeroModulationLeavesOnlyTheContext) {
  torch::manual_seed(70);
  DualStreamBlock block(dual_options());
  cases::draw_parameters(*block, torch::kFloat64);
  {
    const torch::NoGradGuard no_grad;
    for (const nn::Linear& layer : {block->modulation(), block->modulation_skl()}) {
      for (Tensor& parameter : layer->parameters()) parameter.zero_();
    }
    auto parameters = block->named_parameters();
    parameters["context_cross_attn.to_out.weight"].zero_();
    parameters["context_cross_attn_skl.to_out.weight"].zero_();
  }
  const SparseTensor x = cases::random_sparse({12, 7}, 6, 8, torch::kFloat64);
  const SparseTensor x_skl = cases::random_sparse({4, 3}, 6, 6, torch::kFloat64);
  const auto found =
      block->forward(x, x_skl, random_doubles({2, 8}), random_doubles({2, 6}), random_doubles({2, 3, 5}));
  const auto parameters = block->named_parameters();
  EXPECT_LT(cases::distance(found.x.feats, x.feats + parameters["context_cross_attn.to_out.bias"]), 1e-13);
  EXPECT_LT(cases::distance(found.x_skl.feats, x_skl.feats + parameters["context_cross_attn_skl.to_out.bias"]), 1e-13);
}

TEST(DualStreamBlock, SharedModulationIsTheBlocksOwnFormedOutside) {
  torch::manual_seed(71);
  DualStreamBlockOptions options = dual_options();
  DualStreamBlock own(options);
  options.share_mod = true;
  DualStreamBlock shared(options);
  EXPECT_TRUE(shared->modulation().is_empty() && shared->modulation_skl().is_empty());
  cases::draw_parameters(*own, torch::kFloat64);
  shared->to(torch::kFloat64);
  cases::copy_parameters(*own, *shared);
  const SparseTensor x = cases::random_sparse({12, 7}, 6, 8, torch::kFloat64);
  const SparseTensor x_skl = cases::random_sparse({4, 3}, 6, 6, torch::kFloat64);
  const Tensor mod = random_doubles({2, 8}), mod_skl = random_doubles({2, 6}), context = random_doubles({2, 3, 5});
  const auto wanted = own->forward(x, x_skl, mod, mod_skl, context);
  const auto found = shared->forward(x, x_skl, own->modulation()->forward(torch::silu(mod)),
                                     own->modulation_skl()->forward(torch::silu(mod_skl)), context);
  EXPECT_LT(cases::distance(found.x.feats, wanted.x.feats), kDoubleTolerance);
  EXPECT_LT(cases::distance(found.x_skl.feats, wanted.x_skl.feats), kDoubleTolerance);
}

}  // namespace

}  // namespace anigen::sparse
