#include "anigen/sparse/subdivide_block.h"

namespace anigen::sparse {
namespace {

// Without a gradient in place: at 256³ every copy of the features counts.
Tensor normed_silu(SparseGroupNorm& norm, const SparseTensor& x) {
  Tensor rows = norm->forward(x).feats;
  return at::GradMode::is_enabled() ? torch::silu(rows) : at::silu_(rows);
}

}  // namespace

SubdivideBlockImpl::SubdivideBlockImpl(const SubdivideBlockOptions& options) : options_(options) {
  const std::int64_t in = options.channels, out = options.out_channels;
  norm1_ = SparseGroupNorm(in, options.groups);
  norm2_ = SparseGroupNorm(out, options.groups);
  conv1_ = SubmanifoldConv3d(in, out);
  conv2_ = SubmanifoldConv3d(out, out);
  // Published as sequences; their other members, activations, have no parameters.
  torch::nn::ModuleDict act_layers, out_layers;
  act_layers->update({{"0", norm1_.ptr()}});
  out_layers->update({{"0", conv1_.ptr()}, {"1", norm2_.ptr()}, {"3", conv2_.ptr()}});
  register_module("act_layers", act_layers);
  register_module("out_layers", out_layers);
  if (in != out || options.skip_convolution) {
    skip_ = register_module("skip_connection", SubmanifoldConv3d(in, out, 1));
  }
}

// The skip acts on each voxel alone, so it comes before the subdivision: eight children would repeat it.
SparseTensor SubdivideBlockImpl::forward(const SparseTensor& x) {
  SparseTensor h = x.with(normed_silu(norm1_, x));
  if (options_.subdivide) {
    const SubmanifoldKernelImpl& kernel = *conv1_->conv;
    h = {x.support->subdivided(), subdivided_convolution(*x.support, h.feats, kernel.weight, kernel.bias)};
  } else {
    h = conv1_->forward(h);
  }
  h = h.with(normed_silu(norm2_, h));
  h = conv2_->forward(h);
  const Tensor skip = skip_.is_empty() ? x.feats : skip_->forward(x).feats;
  if (!options_.subdivide) return h.with(h.feats + skip);
  const Tensor children = h.feats.view({skip.size(0), 8, h.channels()});
  return h.with((children + skip.unsqueeze(1)).reshape(h.feats.sizes()));
}

void SubdivideBlockImpl::initialize() {
  torch::nn::init::zeros_(conv2_->conv->weight);
  torch::nn::init::zeros_(conv2_->conv->bias);
}

torch::Dtype SubdivideBlockImpl::dtype() const { return nn::dtype_of(conv1_->conv->weight); }

}  // namespace anigen::sparse
