// Blocks of sparse attention. Which options a block has follows from its parameters.
#include <algorithm>
#include <string>
#include <vector>

#include "anigen/nn/linear.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/sparse/blocks.h"
#include "anigen/sparse/windows.h"
#include "tests/parity/parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using sparse::SparseTensor;
using torch::Tensor;

// One more than the largest item of any of these inputs, so that all have the same number of items.
std::int64_t items_of_inputs(const Fixture& fixture, const std::vector<std::string>& coords) {
  std::int64_t items = 0;
  for (const std::string& name : coords)
    items = std::max(items, fixture.input(name).select(1, 0).max().item<std::int64_t>() + 1);
  return items;
}

SparseTensor block_input(const Fixture& fixture, std::int64_t items, const std::string& coords,
                         const std::string& feats) {
  return {sparse::Support::create(fixture.input(coords), items), fixture.input(feats)};
}

// Options that the parameters show; the self attention is called `attention`.
sparse::SparseBlockOptions sparse_block_options_of(const Fixture& fixture, const std::string& part,
                                                   const std::string& attention) {
  const Json& config = fixture.config();
  const io::NamedArrays parameters = parameters_of(fixture, part);
  sparse::SparseBlockOptions options;
  options.channels = config.at("channels");
  options.num_heads = config.at("num_heads");
  options.mlp_ratio = config.at("mlp_ratio");
  options.qkv_bias = has(parameters, attention + ".to_qkv.bias");
  options.qk_rms_norm = has(parameters, attention + ".q_rms_norm.gamma");
  options.qk_rms_norm_cross =
      has(parameters, "cross_attn_0.q_rms_norm.gamma") || has(parameters, "cross_attn.q_rms_norm.gamma");
  options.affine_norms = has(parameters, "norm1.weight");
  options.norm_context = has(parameters, "norm4.weight");
  return options;
}

void run_window_attention(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const Json& config = fixture.config();
  const std::int64_t items = items_of_inputs(fixture, {"x_coords", "c0_coords", "c1_coords"});
  const SparseTensor x = block_input(fixture, items, "x_coords", "x");
  const std::vector<SparseTensor> contexts{block_input(fixture, items, "c0_coords", "c0"),
                                           block_input(fixture, items, "c1_coords", "c1")};
  const std::int64_t window = config.at("window_size");
  for (const std::string& part : fixture.outputs()) {
    const std::string mode = part.substr(part.find('.') + 1);
    const bool cross = part.compare(0, 5, "cross") == 0;
    sparse::SparseBlockOptions options = sparse_block_options_of(fixture, part, cross ? "self_attn" : "attn");
    options.scope =
        sparse::AttentionScope::of(mode == "full" ? "full" : "windowed", window, mode == "win1" ? window / 2 : 0);
    options.cross_scope = options.scope;
    if (cross) {
      options.context_channels = config.at("ctx_channels").get<std::vector<std::int64_t>>();
      sparse::SparseMultiContextBlock block(options);
      load_part(block, fixture, part);
      fixture.check(part, block->forward(x, contexts).feats);
    } else {
      sparse::SparseTransformerBlock block(options);
      load_part(block, fixture, part);
      fixture.check(part, block->forward(x).feats);
    }
  }
}

void run_sparse_blocks(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const Json& config = fixture.config();
  const std::int64_t items = items_of_inputs(fixture, {"coords", "ctx0_coords", "ctx1_coords"});
  const SparseTensor x = block_input(fixture, items, "coords", "feats");
  const std::vector<SparseTensor> contexts{block_input(fixture, items, "ctx0_coords", "ctx0_feats"),
                                           block_input(fixture, items, "ctx1_coords", "ctx1_feats")};
  const auto windowed = sparse::AttentionScope::of("windowed", config.at("window_size"), config.at("shift_window"));

  sparse::SparseBlockOptions options = sparse_block_options_of(fixture, "block", "attn");
  options.scope = windowed;
  sparse::SparseTransformerBlock block(options);
  load_part(block, fixture, "block");
  fixture.check("block", block->forward(x).feats);

  sparse::SparseTransformerBlock full(sparse_block_options_of(fixture, "block_full_affine", "attn"));
  load_part(full, fixture, "block_full_affine");
  fixture.check("block_full_affine", full->forward(x).feats);

  options = sparse_block_options_of(fixture, "cross", "self_attn");
  options.context_channels = {options.channels};  // the context lives on the same rows, with the same width
  sparse::SparseCrossBlock cross(options);
  load_part(cross, fixture, "cross");
  fixture.check("cross", cross->forward(x, x.with(fixture.input("ctx_same_feats"))).feats);

  for (const std::string part : {"multi", "multi_none"}) {
    options = sparse_block_options_of(fixture, part, "self_attn");
    options.scope = options.cross_scope = windowed;
    const bool with_contexts = part == "multi";
    if (with_contexts) options.context_channels = config.at("ctx_channels").get<std::vector<std::int64_t>>();
    sparse::SparseMultiContextBlock multi(options);
    load_part(multi, fixture, part);
    fixture.check(part, multi->forward(x, with_contexts ? contexts : std::vector<SparseTensor>()).feats);
  }
}

// A block whose weights and activations are fp16, on a CPU, where LibTorch does not multiply such matrices: products in
// fp32, rounded. Norms and attention are the ones that blocks use.
class HalfBlock {
 public:
  HalfBlock(sparse::SparseTransformerBlock& block, const sparse::SparseBlockOptions& options)
      : parameters_(block->named_parameters()), options_(options) {}

  Tensor forward(const SparseTensor& x) const {
    const Tensor h = x.feats + attention(x.with(nn::layer_norm(x.feats)));
    const Tensor hidden = nn::gelu_tanh(linear("mlp.mlp.0", nn::layer_norm(h)).to(torch::kFloat32)).to(torch::kHalf);
    return h + linear("mlp.mlp.2", hidden);
  }

 private:
  Tensor linear(const std::string& layer, const Tensor& x) const {
    const Tensor y = torch::linear(x.to(torch::kFloat32), parameters_[layer + ".weight"], parameters_[layer + ".bias"]);
    return y.to(torch::kHalf);
  }
  Tensor normed(const std::string& norm, const Tensor& x) const {
    if (!options_.qk_rms_norm) return x;
    nn::MultiHeadRmsNorm layer(options_.channels / options_.num_heads, options_.num_heads);
    layer->gamma.copy_(parameters_["attn." + norm + ".gamma"]);
    return layer->forward(x);
  }
  Tensor attention(const SparseTensor& x) const {
    const sparse::WindowOrder& windows = x.support->windows(options_.scope.window, options_.scope.shift);
    const Tensor rows = linear("attn.to_qkv", sparse::to_window_order(x.feats, windows));
    const std::int64_t heads = options_.num_heads;
    const std::vector<Tensor> qkv = rows.view({rows.size(0), 3, heads, options_.channels / heads}).unbind(1);
    const Tensor mixed = nn::ragged_attention(normed("q_rms_norm", qkv[0]), normed("k_rms_norm", qkv[1]), qkv[2],
                                              windows.offsets, windows.offsets);
    return linear("attn.to_out", sparse::from_window_order(mixed.reshape(x.feats.sizes()), windows));
  }

  torch::OrderedDict<std::string, Tensor> parameters_;
  sparse::SparseBlockOptions options_;
};

void run_sparse_block_fp16(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const Json& config = fixture.config();
  const io::NamedArrays parameters = fixture.parameters();
  sparse::SparseBlockOptions options;
  options.channels = config.at("channels");
  options.num_heads = config.at("num_heads");
  options.mlp_ratio = config.at("mlp_ratio");
  options.qk_rms_norm = config.at("qk_rms_norm").get<bool>();
  options.scope = sparse::AttentionScope::of("windowed", config.at("window_size"), config.at("shift_window"));
  sparse::SparseTransformerBlock block(options);
  load_whole(block, fixture);
  const SparseTensor x = block_input(fixture, items_of_inputs(fixture, {"coords"}), "coords", "feats");
  fixture.check("y_fp32", block->forward(x).feats);
  const SparseTensor half = x.with(x.feats.to(torch::kHalf));
  fixture.check("y_fp16", HalfBlock(block, options).forward(half).to(torch::kFloat32));
}

sparse::DualStreamBlockOptions dual_stream_options_of(const Fixture& fixture, const std::string& part) {
  const Json& config = fixture.config();
  const io::NamedArrays parameters = parameters_of(fixture, part);
  sparse::DualStreamBlockOptions options;
  options.channels = config.at("channels");
  options.channels_skl = config.at("channels_skl");
  options.num_heads = config.at("num_heads");
  options.num_heads_skl = config.at("num_heads_skl");
  options.context_channels = config.at("ctx_channels");
  options.mlp_ratio = config.at("mlp_ratio");
  options.qkv_bias = has(parameters, "attn.to_kv.bias");
  options.qk_rms_norm = has(parameters, "attn.q_rms_norm.gamma");
  options.qk_rms_norm_cross = has(parameters, "context_cross_attn.q_rms_norm.gamma");
  options.share_mod = !has(parameters, "adaLN_modulation.1.weight");
  return options;
}

void run_sparse_modulated_blocks(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const std::int64_t items = fixture.input("mod").size(0);
  const SparseTensor x = block_input(fixture, items, "coords", "feats");
  const SparseTensor x_skl = block_input(fixture, items, "coords_skl", "feats_skl");
  for (const std::string part : {"block", "block_share"}) {
    const sparse::SparseModulatedBlockOptions options =
        modulated_options<sparse::SparseModulatedBlockOptions>(fixture, part, "attn");
    sparse::SparseModulatedBlock block(options);
    load_part(block, fixture, part);
    fixture.check(part, block->forward(x, fixture.input(options.share_mod ? "mod6" : "mod")).feats);
  }

  sparse::SparseModulatedCrossBlock cross(
      modulated_options<sparse::SparseModulatedBlockOptions>(fixture, "cross", "self_attn"));
  load_part(cross, fixture, "cross");
  fixture.check("cross", cross->forward_dense(x, fixture.input("mod"), fixture.input("context")).feats);

  sparse::DualStreamBlock dual(dual_stream_options_of(fixture, "dual"));
  load_part(dual, fixture, "dual");
  const auto output = dual->forward(x, x_skl, fixture.input("mod"), fixture.input("mod_skl"), fixture.input("context"));
  fixture.check("dual_x", output.x.feats);
  fixture.check("dual_skl", output.x_skl.feats);
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ops_window_attention, anigen::test::run_window_attention)
ANIGEN_DEVICE_PARITY(ops_sparse_blocks, anigen::test::run_sparse_blocks)
ANIGEN_PARITY(ops_sparse_block_fp16, anigen::test::run_sparse_block_fp16)
ANIGEN_DEVICE_PARITY(ops_sparse_modulated_blocks, anigen::test::run_sparse_modulated_blocks)
