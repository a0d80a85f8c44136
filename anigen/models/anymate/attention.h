#pragma once
#include "anigen/models/anymate/key_mask.h"
#include "anigen/nn/linear.h"

namespace anigen::models::anymate {

/// Self attention with keys `c_qkv.*` and `c_proj.*`. Head h owns rows 3dh … 3d(h+1) of c_qkv: its q, then k, then v
/// (reference anymate-baselines.md, 2.1), unlike nn::DenseAttention.
class InterleavedSelfAttentionImpl : public torch::nn::Module {
 public:
  /// @throws InputError when heads do not divide the width
  InterleavedSelfAttentionImpl(std::int64_t width, std::int64_t heads, bool qkv_bias);
  Tensor forward(const Tensor& x, const KeyMask& mask);  ///< @param x [B, N, W] @return [B, N, W]

 private:
  std::int64_t heads_;
  nn::Linear c_qkv_ = nullptr, c_proj_ = nullptr;
};
TORCH_MODULE(InterleavedSelfAttention);

/// Cross attention with keys `c_q.*`, `c_kv.*` (head by head: k, then v) and `c_proj.*`.
class InterleavedCrossAttentionImpl : public torch::nn::Module {
 public:
  InterleavedCrossAttentionImpl(std::int64_t width, std::int64_t data_width, std::int64_t heads, bool qkv_bias);
  /// @param x [B, N, W] @param data [B, M, D] @return [B, N, W]
  Tensor forward(const Tensor& x, const Tensor& data, const KeyMask& mask);

 private:
  std::int64_t heads_;
  nn::Linear c_q_ = nullptr, c_kv_ = nullptr, c_proj_ = nullptr;
};
TORCH_MODULE(InterleavedCrossAttention);

/// Attention with keys `wq.*`, `wk.*`, `wv.*`, `proj.*`; head j owns channels jd … (j+1)d of each (reference
/// anymate-baselines.md, 3.4).
class SeparateAttentionImpl : public torch::nn::Module {
 public:
  SeparateAttentionImpl(std::int64_t width, std::int64_t data_width, std::int64_t heads, bool qkv_bias);
  /// @param x [B, N, W] @param data [B, M, D] @return [B, N, W]
  Tensor forward(const Tensor& x, const Tensor& data);

 private:
  std::int64_t heads_;
  nn::Linear wq_ = nullptr, wk_ = nullptr, wv_ = nullptr, proj_ = nullptr;
};
TORCH_MODULE(SeparateAttention);

}  // namespace anigen::models::anymate
