#pragma once
#include "anigen/models/anymate/blocks.h"

namespace anigen::models::anymate {

/// Widths of the two streams of a read-compute-write denoiser: a few latents z that think, many points x that are read
/// and written (Jabri et al. 2023, "Scalable Adaptive Computation for Iterative Generation"; reference
/// anymate-baselines.md, 3.4).
struct ReadWriteOptions {
  std::int64_t z_dim = 768, x_dim = 512, num_heads = 8;
  double mlp_ratio = 4.0;
  bool qkv_bias = true;
};

/// z += attn(norm_z1 z, norm_x x), z += mlp(norm_z2 z). Keys `norm_x`, `norm_z1`, `attn.*`, `norm_z2`, `mlp.{fc1,fc2}`.
class ReadBlockImpl : public torch::nn::Module {
 public:
  explicit ReadBlockImpl(const ReadWriteOptions& options);
  Tensor forward(const Tensor& z, const Tensor& x);  ///< @param z [B, M, z_dim] @param x [B, N, x_dim] @return z

 private:
  nn::AffineLayerNorm norm_x_ = nullptr, norm_z1_ = nullptr, norm_z2_ = nullptr;
  SeparateAttention attention_ = nullptr;
  ErfMlp mlp_ = nullptr;
};
TORCH_MODULE(ReadBlock);

/// z += attn(norm_z1 z, norm_z1 z), z += mlp(norm_z2 z). Keys `norm_z1`, `attn.*`, `norm_z2`, `mlp.{fc1,fc2}`.
class ComputeBlockImpl : public torch::nn::Module {
 public:
  explicit ComputeBlockImpl(const ReadWriteOptions& options);
  Tensor forward(const Tensor& z);  ///< @param z [B, M, z_dim] @return z

 private:
  nn::AffineLayerNorm norm_z1_ = nullptr, norm_z2_ = nullptr;
  SeparateAttention attention_ = nullptr;
  ErfMlp mlp_ = nullptr;
};
TORCH_MODULE(ComputeBlock);

/// x += attn(norm_x1 x, norm_z z), x += mlp(norm_x2 x). Keys `norm_z`, `norm_x1`, `attn.*`, `norm_x2`, `mlp.{fc1,fc2}`.
class WriteBlockImpl : public torch::nn::Module {
 public:
  explicit WriteBlockImpl(const ReadWriteOptions& options);
  Tensor forward(const Tensor& z, const Tensor& x);  ///< @param z [B, M, z_dim] @param x [B, N, x_dim] @return x

 private:
  nn::AffineLayerNorm norm_z_ = nullptr, norm_x1_ = nullptr, norm_x2_ = nullptr;
  SeparateAttention attention_ = nullptr;
  ErfMlp mlp_ = nullptr;
};
TORCH_MODULE(WriteBlock);

/// One read, several computes, one write. Keys `read.*`, `write.*`, `compute.<i>.*`.
class ReadComputeWriteImpl : public torch::nn::Module {
 public:
  ReadComputeWriteImpl(const ReadWriteOptions& options, std::int64_t compute_layers);
  void forward(Tensor& z, Tensor& x);  ///< both are replaced

 private:
  ReadBlock read_ = nullptr;
  WriteBlock write_ = nullptr;
  std::vector<ComputeBlock> compute_;
};
TORCH_MODULE(ReadComputeWrite);

}  // namespace anigen::models::anymate
