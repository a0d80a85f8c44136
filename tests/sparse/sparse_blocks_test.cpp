#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "anigen/nn/dense_block.h"
#include "anigen/nn/modulated_block.h"
#include "anigen/sparse/dual_stream_block.h"
#include "anigen/sparse/modulated_block.h"
#include "anigen/sparse/transformer_block.h"
#include "tests/sparse/attention_cases.h"

namespace anigen::sparse {
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
  // What a layer norm without parameters does not see; its eps of 1e-6 beside variances of size one does.
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
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      EXPECT_LT(cases::distance(gradients[i], wanted_gradients[i]), 1e-10) << sparse_context << " " << i;
    }
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
