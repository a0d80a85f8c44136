#include "anigen/models/sparse_structure_flow_stream.h"

#include "anigen/core/error.h"
#include "anigen/models/recompute.h"
#include "anigen/nn/layer_norm.h"
#include "anigen/nn/volume_layout.h"

namespace anigen::models {
namespace {

using torch::Tensor;

constexpr double kFinalNormEps = 1e-5;

std::string size_text(const std::vector<std::int64_t>& sizes) {
  std::string text = "[B";
  for (std::size_t i = 1; i < sizes.size(); ++i) text += ", " + std::to_string(sizes[i]);
  return text + "]";
}

}  // namespace

std::vector<std::int64_t> FlowStream::latent_size(std::int64_t batch) const {
  if (is_global) return {batch, tokens, in_channels};
  return {batch, in_channels, resolution, resolution, resolution};
}

void FlowStream::check_latent(const Tensor& x) const {
  const std::vector<std::int64_t> wanted = latent_size(x.dim() > 0 ? x.size(0) : 0);
  if (x.sizes() == torch::IntArrayRef(wanted)) return;
  throw InputError("", name, "expected shape " + size_text(wanted) + ", found " + c10::str(x.sizes()));
}

Tensor FlowStream::embed_tokens(const Tensor& x) {
  const Tensor rows = is_global ? x : nn::patchify(x, patch).flatten(2).transpose(1, 2).contiguous();
  return input_layer->forward(rows) + pos_emb;
}

Tensor FlowStream::modulation_of(const Tensor& t) {
  const Tensor embedding = t_embedder->forward(t);
  return shared_modulation.is_empty() ? embedding : shared_modulation->forward(embedding);
}

Tensor FlowStream::run(nn::ModulatedCrossBlock block, const Tensor& h, const Tensor& modulation,
                       const Tensor& context) const {
  if (!recompute || !at::GradMode::is_enabled()) return block->forward(h, modulation, context);
  return recomputed({h, modulation, context}, [block](const std::vector<Tensor>& inputs) mutable {
    return block->forward(inputs[0], inputs[1], inputs[2]);
  });
}

Tensor FlowStream::run_block(std::size_t i, const Tensor& h, const Tensor& modulation, const Tensor& context) {
  return run(blocks[i], h, modulation, context);
}

Tensor FlowStream::receive(std::size_t i, std::int64_t crossing, const Tensor& own, const Tensor& other,
                           const Tensor& modulation) {
  if (!adapters.empty()) return own + adapters[i]->forward(other);
  if (cross_blocks.empty() || crossing < 0) return own;
  const auto c = static_cast<std::size_t>(crossing);
  const Tensor crossed = run(cross_blocks[c], own, modulation, other);
  return own + cross_outputs[c]->forward(crossed - own);
}

Tensor FlowStream::project(const Tensor& h) {
  const Tensor rows = out_layer->forward(nn::layer_norm(h, kFinalNormEps));
  if (is_global) return rows;
  const std::int64_t side = resolution / patch;
  return nn::unpatchify(rows.transpose(1, 2).reshape({h.size(0), rows.size(2), side, side, side}), patch);
}

}  // namespace anigen::models
