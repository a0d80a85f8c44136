#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/attention.h"
#include "anigen/sparse/attention.h"
#include "anigen/sparse/windows.h"
#include "tests/sparse/attention_cases.h"
#include "tests/support/kernel_forms.h"

namespace anigen::sparse {
namespace {

using Parameters = torch::OrderedDict<std::string, Tensor>;

SparseAttentionOptions sparse_attention_of(std::int64_t channels, std::int64_t heads, std::int64_t context,
                                           bool windowed, std::int64_t window = 4, std::int64_t shift = 0) {
  SparseAttentionOptions options;
  options.channels = channels;
  options.num_heads = heads;
  options.context_channels = context;
  options.scope = AttentionScope::of(windowed ? "swin" : "full", window, shift);
  return options;
}

// Numbers of the windows of all rows as published: from the largest shifted coordinate of the tensor itself.
Tensor published_window_numbers(const Support& support, std::int64_t window, std::int64_t shift) {
  const Tensor coords = support.coords().to(torch::kInt64);
  const Tensor shifted = coords.slice(1, 1) + shift;
  const Tensor cells = torch::floor_divide(shifted, window);
  Tensor number = coords.select(1, 0);
  for (std::int64_t axis = 0; axis < 3; ++axis) {
    const std::int64_t extent = cells.select(1, axis).max().item<std::int64_t>() + 1;
    number = number * extent + cells.select(1, axis);
  }
  return number;
}

Tensor item_numbers(const Support& support) { return support.coords().select(1, 0).to(torch::kInt64); }

// Attention of all rows to all rows whose group has the same number, with every score: [N, C], before to_out.
Tensor masked_attention(const Tensor& q, const Tensor& k, const Tensor& v, std::int64_t heads, const Tensor& q_groups,
                        const Tensor& k_groups) {
  const std::int64_t width = q.size(1) / heads;
  const Tensor apart = q_groups.unsqueeze(1) != k_groups.unsqueeze(0);
  const Tensor lonely = apart.all(1).unsqueeze(1);
  std::vector<Tensor> mixed;
  for (std::int64_t h = 0; h < heads; ++h) {
    const auto head = [&](const Tensor& x) { return x.narrow(1, h * width, width); };
    const Tensor scores = head(q).mm(head(k).t()) / std::sqrt(static_cast<double>(width));
    // Rows without keys keep finite scores here, and become zero below.
    const Tensor hidden =
        scores.masked_fill(apart.logical_and(lonely.logical_not()), -std::numeric_limits<double>::infinity());
    mixed.push_back(torch::softmax(hidden, 1).mm(head(v)).masked_fill(lonely, 0.0));
  }
  return torch::cat(mixed, 1);
}

Tensor projected(const Parameters& p, const char* layer, const Tensor& x) {
  return torch::linear(x, p[std::string(layer) + ".weight"], p[std::string(layer) + ".bias"]);
}

Tensor masked_self_attention(const Parameters& p, std::int64_t heads, const Tensor& x, const Tensor& groups) {
  const std::vector<Tensor> qkv = projected(p, "to_qkv", x).chunk(3, 1);
  return projected(p, "to_out", masked_attention(qkv[0], qkv[1], qkv[2], heads, groups, groups));
}

Tensor masked_cross_attention(const Parameters& p, std::int64_t heads, const Tensor& x, const Tensor& context,
                              const Tensor& groups, const Tensor& context_groups) {
  const std::vector<Tensor> kv = projected(p, "to_kv", context).chunk(2, 1);
  return projected(p, "to_out", masked_attention(projected(p, "to_q", x), kv[0], kv[1], heads, groups, context_groups));
}

// An attention in fp32, and its parameters in fp64 for the masked formula.
struct AttentionPair {
  explicit AttentionPair(const SparseAttentionOptions& options) : fast(options), exact(options) {
    cases::draw_parameters(*fast, torch::kFloat32);
    exact->to(torch::kFloat64);
    cases::copy_parameters(*fast, *exact);
  }
  SparseAttention fast, exact;

  // fp32 sums of some ten to hundred terms of size one.
  void expect_equal(const Tensor& found, const Tensor& wanted, const std::vector<Tensor>& inputs,
                    const std::vector<Tensor>& exact_inputs) {
    EXPECT_LT(cases::distance(found, wanted), 1e-5 * (1.0 + wanted.abs().max().item<double>()));
    const Tensor direction = torch::randn_like(wanted);
    std::vector<Tensor> variables = inputs, exact_variables = exact_inputs;
    for (const Tensor& parameter : fast->parameters()) variables.push_back(parameter);
    for (const Tensor& parameter : exact->parameters()) exact_variables.push_back(parameter);
    const auto gradients = torch::autograd::grad({found}, variables, {direction.to(torch::kFloat32)});
    const auto exact_gradients = torch::autograd::grad({wanted}, exact_variables, {direction});
    for (std::size_t i = 0; i < gradients.size(); ++i) {
      const double scale = 1.0 + exact_gradients[i].abs().max().item<double>();
      EXPECT_LT(cases::distance(gradients[i], exact_gradients[i]), 1e-5 * scale) << "gradient " << i;
    }
  }
};

Tensor exact_copy(const Tensor& x) { return x.detach().to(torch::kFloat64).requires_grad_(); }

KERNEL_TEST(SparseAttention, WindowedSelfAttentionIsMaskedAttention) {
  torch::manual_seed(51);
  for (const auto& [window, shift] : {std::pair(4, 0), std::pair(4, 2), std::pair(3, 1), std::pair(20, 0)}) {
    AttentionPair pair(sparse_attention_of(24, 3, 0, true, window, shift));
    const SparseTensor x = cases::random_sparse({150, 0, 90, 1}, 10, 24);
    x.feats.requires_grad_();
    const Tensor exact = exact_copy(x.feats);
    const Tensor groups = published_window_numbers(*x.support, window, shift);
    pair.expect_equal(pair.fast->forward(x).feats,
                      masked_self_attention(pair.exact->named_parameters(), 3, exact, groups), {x.feats}, {exact});
    // Full attention that is asked for windows.
    SparseAttention full(sparse_attention_of(24, 3, 0, false));
    cases::copy_parameters(*pair.fast, *full);
    EXPECT_TRUE(torch::equal(full->forward_in(x, AttentionScope::of("swin", window, shift)).feats,
                             pair.fast->forward(x).feats));
  }
}

KERNEL_TEST(SparseAttention, FullSelfAttentionIsMaskedAttention) {
  torch::manual_seed(52);
  AttentionPair pair(sparse_attention_of(24, 2, 0, false));
  const SparseTensor x = cases::random_sparse({140, 1, 0, 60}, 10, 24);
  x.feats.requires_grad_();
  const Tensor exact = exact_copy(x.feats);
  pair.expect_equal(pair.fast->forward(x).feats,
                    masked_self_attention(pair.exact->named_parameters(), 2, exact, item_numbers(*x.support)),
                    {x.feats}, {exact});
}

// Contexts of the same and of another extent than the queries: the numbers decide, not the places.
KERNEL_TEST(SparseAttention, WindowedCrossAttentionPairsWindowsByNumber) {
  torch::manual_seed(53);
  for (const std::int64_t side : {9, 13}) {
    AttentionPair pair(sparse_attention_of(16, 2, 12, true, 3, 1));
    const SparseTensor x = cases::random_sparse({120, 70}, 9, 16), context = cases::random_sparse({30, 40}, side, 12);
    x.feats.requires_grad_();
    context.feats.requires_grad_();
    const Tensor exact = exact_copy(x.feats), exact_context = exact_copy(context.feats);
    const Tensor groups = published_window_numbers(*x.support, 3, 1);
    const Tensor context_groups = published_window_numbers(*context.support, 3, 1);
    const Tensor lonely = (groups.unsqueeze(1) != context_groups.unsqueeze(0)).all(1);
    ASSERT_TRUE(lonely.any().item<bool>());
    const Tensor found = pair.fast->forward(x, context).feats;
    pair.expect_equal(
        found, masked_cross_attention(pair.exact->named_parameters(), 2, exact, exact_context, groups, context_groups),
        {x.feats, context.feats}, {exact, exact_context});
    // Without keys nothing but the bias of to_out is left.
    const Tensor bias = pair.fast->named_parameters()["to_out.bias"];
    EXPECT_TRUE((found.index({lonely}) == bias).all().item<bool>());
  }
}

KERNEL_TEST(SparseAttention, FullCrossAttentionStaysInTheItem) {
  torch::manual_seed(54);
  AttentionPair pair(sparse_attention_of(16, 4, 10, false));
  const SparseTensor x = cases::random_sparse({30, 50, 20}, 8, 16), context = cases::random_sparse({12, 7, 0}, 8, 10);
  x.feats.requires_grad_();
  context.feats.requires_grad_();
  const Tensor exact = exact_copy(x.feats), exact_context = exact_copy(context.feats);
  pair.expect_equal(pair.fast->forward(x, context).feats,
                    masked_cross_attention(pair.exact->named_parameters(), 4, exact, exact_context,
                                           item_numbers(*x.support), item_numbers(*context.support)),
                    {x.feats, context.feats}, {exact, exact_context});
}

// Each item as a dense batch of its own, by the dense attention of the same keys.
TEST(SparseAttention, DenseContextIsWhatDenseAttentionDoes) {
  torch::manual_seed(55);
  SparseAttentionOptions options = sparse_attention_of(12, 3, 10, false);
  options.qk_rms_norm = true;
  SparseAttention attention(options);
  cases::draw_parameters(*attention, torch::kFloat64);
  nn::AttentionOptions dense_options;
  dense_options.channels = 12;
  dense_options.num_heads = 3;
  dense_options.context_channels = 10;
  dense_options.qk_rms_norm = true;
  nn::DenseAttention dense(dense_options);
  dense->to(torch::kFloat64);
  cases::copy_parameters(*attention, *dense);
  const SparseTensor x = cases::random_sparse({14, 3}, 8, 12, torch::kFloat64);
  const Tensor context = torch::randn({2, 6, 10}, torch::kFloat64);
  const std::vector<Tensor> found = x.support->items().split(attention->forward_dense(x, context).feats);
  const std::vector<Tensor> rows = x.support->items().split(x.feats);
  for (std::int64_t b = 0; b < 2; ++b) {
    const auto at = static_cast<std::size_t>(b);
    const Tensor wanted = dense->forward(rows[at].unsqueeze(0), context.narrow(0, b, 1))[0];
    EXPECT_LT(cases::distance(found[at], wanted), 1e-12) << b;
  }
}

TEST(SparseAttention, OrderOfRowsDoesNotMatter) {
  torch::manual_seed(56);
  SparseAttention attention(sparse_attention_of(8, 2, 0, true, 4, 2));
  cases::draw_parameters(*attention, torch::kFloat64);
  const Tensor coords = cases::random_voxels({80}, 9), feats = torch::randn({80, 8}, torch::kFloat64);
  const Tensor order = torch::randperm(80);
  const Tensor found = attention->forward({Support::create(coords), feats}).feats;
  const Tensor shuffled =
      attention->forward({Support::create(coords.index_select(0, order)), feats.index_select(0, order)}).feats;
  EXPECT_LT(cases::distance(shuffled, found.index_select(0, order)), 1e-12);
}

TEST(SparseAttention, NothingInNothingOut) {
  for (const bool windowed : {false, true}) {
    SparseAttention attention(sparse_attention_of(8, 2, 0, windowed));
    cases::draw_parameters(*attention, torch::kFloat32);
    const SparseTensor none{Support::create(torch::zeros({0, 4}, torch::kInt32), 2), torch::zeros({0, 8})};
    EXPECT_EQ(attention->forward(none).feats.sizes(), none.feats.sizes());
  }
}

TEST(SparseAttention, RejectsWhatDoesNotFit) {
  EXPECT_THROW(SparseAttention(sparse_attention_of(10, 3, 0, false)), c10::Error);
  torch::manual_seed(57);
  SparseAttention self(sparse_attention_of(8, 2, 0, false)), cross(sparse_attention_of(8, 2, 6, false));
  SparseAttention windowed(sparse_attention_of(8, 2, 6, true));
  for (SparseAttention* attention : {&self, &cross, &windowed}) cases::draw_parameters(**attention, torch::kFloat32);
  const SparseTensor x = cases::random_sparse({5, 4}, 6, 8), context = cases::random_sparse({5, 4}, 6, 6);
  EXPECT_THROW(self->forward(x, context), c10::Error);
  EXPECT_THROW(self->forward(context), c10::Error);
  EXPECT_THROW(self->forward(x.with(x.feats.narrow(0, 0, 5))), c10::Error);
  EXPECT_THROW(cross->forward(x), c10::Error);
  EXPECT_THROW(cross->forward(x, x), c10::Error);
  EXPECT_THROW(cross->forward(x, cases::random_sparse({9}, 6, 6)), c10::Error);
  EXPECT_THROW(cross->forward_dense(x, torch::zeros({1, 3, 6})), c10::Error);
  EXPECT_THROW(windowed->forward_dense(x, torch::zeros({2, 3, 6})), c10::Error);
}

TEST(AttentionScope, PublishedModes) {
  EXPECT_FALSE(AttentionScope::of("full", 8, 4).windowed);
  for (const char* mode : {"swin", "windowed"}) {
    const AttentionScope scope = AttentionScope::of(mode, 6, 3);
    EXPECT_TRUE(scope.windowed);
    EXPECT_EQ(scope.window, 6);
    EXPECT_EQ(scope.shift, 3);
  }
  for (const char* mode : {"serialized", "shift_window", "shift_sequence", "shift_order"})
    EXPECT_THROW(AttentionScope::of(mode, 8, 0), NotSupportedError) << mode;
  EXPECT_THROW(AttentionScope::of("local", 8, 0), InputError);
  EXPECT_THROW(AttentionScope::of("swin", 0, 0), InputError);
  EXPECT_THROW(AttentionScope::of("swin", 8, -1), InputError);
}

TEST(WindowRows, UnionOfWindowNumbers) {
  const auto windows_of = [](std::vector<std::int64_t> numbers, std::vector<std::int64_t> offsets) {
    const auto options = torch::TensorOptions().dtype(torch::kInt64);
    WindowOrder windows;
    windows.windows = torch::tensor(numbers, options);
    windows.offsets = torch::tensor(offsets, options);
    return windows;
  };
  const PairedOffsets pairs = pair_windows(windows_of({2, 5, 9}, {0, 3, 4, 8}), windows_of({0, 5, 11}, {0, 2, 7, 8}));
  const auto list = [](std::vector<std::int64_t> values) {
    return torch::tensor(values, torch::TensorOptions().dtype(torch::kInt64));
  };
  EXPECT_TRUE(torch::equal(pairs.queries, list({0, 0, 3, 4, 8, 8})));  // windows 0, 2, 5, 9, 11
  EXPECT_TRUE(torch::equal(pairs.keys, list({0, 2, 2, 7, 7, 8})));
}

TEST(WindowRows, ThereAndBackWithGradient) {
  torch::manual_seed(58);
  const SparseTensor x = cases::random_sparse({60}, 8, 3, torch::kFloat64);
  const WindowOrder& windows = x.support->windows(4, 1);
  x.feats.requires_grad_();
  const Tensor sorted = to_window_order(x.feats, windows);
  EXPECT_TRUE(torch::equal(sorted, x.feats.index_select(0, windows.order.host())));
  EXPECT_TRUE(torch::equal(from_window_order(sorted, windows), x.feats));
  const Tensor direction = torch::randn({60, 3}, torch::kFloat64);
  const Tensor gradient = torch::autograd::grad({sorted}, {x.feats}, {direction})[0];
  EXPECT_TRUE(torch::equal(gradient.index_select(0, windows.order.host()), direction));
}

}  // namespace
}  // namespace anigen::sparse
