#include "anigen/sparse/residual_block.h"

#include <vector>

#include "anigen/nn/init.h"
#include "anigen/nn/layer_norm.h"
#include "anigen/sparse/item_modulation.h"
#include "anigen/sparse/resampling.h"

namespace anigen::sparse {

ResidualBlockImpl::ResidualBlockImpl(const ResidualBlockOptions& options) {
  const std::int64_t in = options.channels, out = options.out_channels;
  norm1_ = register_module("norm1", nn::AffineLayerNorm(in, nn::kBlockNormEps));
  conv1_ = register_module("conv1", SubmanifoldConv3d(in, out));
  conv2_ = register_module("conv2", SubmanifoldConv3d(out, out));
  modulation_ = register_module("emb_layers", nn::Modulation(options.embedding_channels, 2 * out));
  if (in != out) skip_ = register_module("skip_connection", nn::Linear(in, out));
}

SparseTensor ResidualBlockImpl::forward(const SparseTensor& x, const Tensor& embedding) {
  return finish(conv1_->forward(x.with(activated(x.feats))), skipped(x.feats), embedding);
}

SparseTensor ResidualBlockImpl::forward_up(const SparseTensor& x, const SupportPtr& fine, const Tensor& embedding) {
  const SparseTensor h = upsample(x.with(activated(x.feats)), fine, 2);
  return finish(conv1_->forward(h), upsample(x.with(skipped(x.feats)), fine, 2).feats, embedding);
}

Tensor ResidualBlockImpl::activated(const Tensor& rows) { return norm1_->activated(rows); }

Tensor ResidualBlockImpl::skipped(const Tensor& rows) { return skip_.is_empty() ? rows : skip_->forward(rows); }

SparseTensor ResidualBlockImpl::finish(const SparseTensor& h, const Tensor& skip, const Tensor& embedding) {
  const std::int64_t items = h.support->items().items();
  const Tensor values = modulation_->forward(embedding);
  TORCH_CHECK(values.dim() == 2 && values.size(0) == items, "a residual block of ", items, " items was given the ",
              "embedding ", embedding.sizes());
  const std::vector<Tensor> parts = values.chunk(2, -1);
  const ItemModulation modulation(h.support, /*shift=*/parts[1], /*scale=*/parts[0]);
  return h.with(conv2_->forward(h.with(torch::silu(modulation.modulate(h.feats)))).feats + skip);
}

void ResidualBlockImpl::initialize() { nn::zero_parameters(*conv2_); }

}  // namespace anigen::sparse
