#include "anigen/models/anymate/read_write_blocks.h"

#include "anigen/nn/module_list.h"

namespace anigen::models::anymate {
namespace {

ErfMlp stream_mlp(std::int64_t width, double ratio) {
  return ErfMlp(width, static_cast<std::int64_t>(static_cast<double>(width) * ratio), width, "fc1", "fc2");
}

}  // namespace

ReadBlockImpl::ReadBlockImpl(const ReadWriteOptions& options) {
  norm_x_ = register_module("norm_x", nn::AffineLayerNorm(options.x_dim, kNormEps));
  norm_z1_ = register_module("norm_z1", nn::AffineLayerNorm(options.z_dim, kNormEps));
  attention_ =
      register_module("attn", SeparateAttention(options.z_dim, options.x_dim, options.num_heads, options.qkv_bias));
  norm_z2_ = register_module("norm_z2", nn::AffineLayerNorm(options.z_dim, kNormEps));
  mlp_ = register_module("mlp", stream_mlp(options.z_dim, options.mlp_ratio));
}

Tensor ReadBlockImpl::forward(const Tensor& z, const Tensor& x) {
  const Tensor read = z + attention_(norm_z1_(z), norm_x_(x));
  return read + mlp_(norm_z2_(read));
}

ComputeBlockImpl::ComputeBlockImpl(const ReadWriteOptions& options) {
  norm_z1_ = register_module("norm_z1", nn::AffineLayerNorm(options.z_dim, kNormEps));
  attention_ =
      register_module("attn", SeparateAttention(options.z_dim, options.z_dim, options.num_heads, options.qkv_bias));
  norm_z2_ = register_module("norm_z2", nn::AffineLayerNorm(options.z_dim, kNormEps));
  mlp_ = register_module("mlp", stream_mlp(options.z_dim, options.mlp_ratio));
}

Tensor ComputeBlockImpl::forward(const Tensor& z) {
  const Tensor normed = norm_z1_(z), attended = z + attention_(normed, normed);
  return attended + mlp_(norm_z2_(attended));
}

WriteBlockImpl::WriteBlockImpl(const ReadWriteOptions& options) {
  norm_z_ = register_module("norm_z", nn::AffineLayerNorm(options.z_dim, kNormEps));
  norm_x1_ = register_module("norm_x1", nn::AffineLayerNorm(options.x_dim, kNormEps));
  attention_ =
      register_module("attn", SeparateAttention(options.x_dim, options.z_dim, options.num_heads, options.qkv_bias));
  norm_x2_ = register_module("norm_x2", nn::AffineLayerNorm(options.x_dim, kNormEps));
  mlp_ = register_module("mlp", stream_mlp(options.x_dim, options.mlp_ratio));
}

Tensor WriteBlockImpl::forward(const Tensor& z, const Tensor& x) {
  const Tensor written = x + attention_(norm_x1_(x), norm_z_(z));
  return written + mlp_(norm_x2_(written));
}

ReadComputeWriteImpl::ReadComputeWriteImpl(const ReadWriteOptions& options, std::int64_t compute_layers) {
  read_ = register_module("read", ReadBlock(options));
  write_ = register_module("write", WriteBlock(options));
  for (std::int64_t i = 0; i < compute_layers; ++i) compute_.emplace_back(options);
  register_module("compute", nn::module_list(compute_));
}

void ReadComputeWriteImpl::forward(Tensor& z, Tensor& x) {
  z = read_(z, x);
  for (ComputeBlock& block : compute_) z = block->forward(z);
  x = write_(z, x);
}

}  // namespace anigen::models::anymate
