// Attention over sparse tensors. Which options a module has follows from its parameters.
#include <string>
#include <vector>

#include "anigen/sparse/attention.h"
#include "tests/parity/parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using sparse::SparseTensor;
using torch::Tensor;

// Items of a fixture whose last ones may be empty in some of its tensors.
std::int64_t items_of_fixture(const Fixture& fixture) {
  return static_cast<std::int64_t>(fixture.config().at("counts").size());
}

SparseTensor attention_input(const Fixture& fixture, const std::string& coords, const std::string& feats) {
  return {sparse::Support::create(fixture.input(coords), items_of_fixture(fixture)), fixture.input(feats)};
}

sparse::SparseAttentionOptions attention_options_of(const Fixture& fixture, const io::NamedArrays& parameters) {
  const Json& config = fixture.config();
  const bool cross = has(parameters, "to_kv.weight");
  sparse::SparseAttentionOptions options;
  options.channels = config.at("channels");
  options.num_heads = config.at("num_heads");
  if (cross) options.context_channels = config.at("ctx_channels");
  options.qkv_bias = has(parameters, cross ? "to_kv.bias" : "to_qkv.bias");
  options.qk_rms_norm = has(parameters, "q_rms_norm.gamma");
  return options;
}

void run_sparse_attention_full(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const SparseTensor x = attention_input(fixture, "coords", "feats");
  const SparseTensor context = attention_input(fixture, "ctx_coords", "ctx_feats");
  for (const std::string& part : fixture.outputs()) {
    sparse::SparseAttention attention(attention_options_of(fixture, parameters_of(fixture, part)));
    load_part(attention, fixture, part);
    if (part == "cross_dense") {
      fixture.check(part, attention->forward_dense(x, fixture.input("ctx_dense")).feats);
    } else if (part == "cross_sparse") {
      fixture.check(part, attention->forward(x, context).feats);
    } else {
      fixture.check(part, attention->forward(x).feats);
    }
  }
}

sparse::SparseAttention windowed_attention(const Fixture& fixture, std::int64_t shift) {
  const io::NamedArrays parameters = fixture.parameters();
  sparse::SparseAttentionOptions options = attention_options_of(fixture, parameters);
  options.scope = sparse::AttentionScope::of("windowed", fixture.config().at("window_size"), shift);
  sparse::SparseAttention attention(options);
  load_whole(attention, fixture);
  return attention;
}

// The two shifts of a fixture with the endings of their outputs.
struct WindowShift {
  std::int64_t shift;
  std::string ending;
};
std::vector<WindowShift> window_shifts(const Fixture& fixture) {
  return {{0, "shift0"}, {fixture.config().at("window_size").get<std::int64_t>() / 2, "shift"}};
}

void run_sparse_attention_windowed_self(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const SparseTensor x = attention_input(fixture, "coords", "feats");
  for (const WindowShift& shift : window_shifts(fixture)) {
    const std::int64_t size = fixture.config().at("window_size");
    fixture.check("y_" + shift.ending, windowed_attention(fixture, shift.shift)->forward(x).feats);
    const sparse::WindowOrder& windows = x.support->windows(size, shift.shift);
    const Tensor lengths = windows.offsets.diff();
    fixture.check("lens_" + shift.ending, lengths);
    const Tensor ordinals = torch::repeat_interleave(torch::arange(lengths.size(0)), lengths);
    fixture.check("window_" + shift.ending, ordinals.index_select(0, windows.place.host()));
  }
}

// 1 for rows in windows whose number no window of the context has.
Tensor rows_without_keys(const sparse::WindowOrder& queries, const sparse::WindowOrder& keys) {
  const Tensor lonely = (queries.windows.unsqueeze(1) != keys.windows.unsqueeze(0)).all(1).to(torch::kInt32);
  return torch::repeat_interleave(lonely, queries.offsets.diff()).index_select(0, queries.place.host());
}

void run_sparse_attention_windowed_cross(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  const SparseTensor x = attention_input(fixture, "coords", "feats");
  const SparseTensor context = attention_input(fixture, "ctx_coords", "ctx_feats");
  const std::int64_t size = fixture.config().at("window_size");
  for (const WindowShift& shift : window_shifts(fixture)) {
    fixture.check("y_" + shift.ending, windowed_attention(fixture, shift.shift)->forward(x, context).feats);
    fixture.check("no_key_" + shift.ending, rows_without_keys(x.support->windows(size, shift.shift),
                                                              context.support->windows(size, shift.shift)));
  }
  const SparseTensor far = attention_input(fixture, "ctx_coords_far", "ctx_feats");
  fixture.check("y_mismatch", windowed_attention(fixture, 0)->forward(x, far).feats);
}

// No published config uses it; the words are the program's own.
void run_sparse_attention_serialized(Fixture& fixture) {
  sparse::AttentionScope::of("serialized", fixture.config().at("window_size"), 0);
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ops_sparse_attn_full, anigen::test::run_sparse_attention_full)
ANIGEN_DEVICE_PARITY(ops_sparse_attn_windowed_self, anigen::test::run_sparse_attention_windowed_self)
ANIGEN_DEVICE_PARITY(ops_sparse_attn_windowed_cross, anigen::test::run_sparse_attention_windowed_cross)
ANIGEN_PARITY(ops_sparse_attn_serialized, anigen::test::run_sparse_attention_serialized)
