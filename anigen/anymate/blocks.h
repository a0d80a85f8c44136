#pragma once
#include <string>
#include <vector>

#include "anigen/nn/gelu_erf.h"
#include "anigen/nn/init.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/torch.h"

namespace anigen::anymate {

using torch::Tensor;

/// Mask of the keys that count in each item of a batch. The released models set the scores of the others to -1e8, whose
/// softmax is zero in fp32 unless an item has no key that counts, which then attends to all of its keys alike.
class KeyMask {
 public:
  KeyMask() = default;  ///< all keys count
  /// @param mask [B, S], numbers or bool: not zero where the key counts @throws InputError for another shape
  explicit KeyMask(const Tensor& mask);

  /// True when nothing is masked.
  bool all() const { return rows_.empty(); }
  std::int64_t items() const { return static_cast<std::int64_t>(rows_.size()); }
  std::int64_t keys() const { return keys_; }
  /// Of an item: int64 indices of the keys that count; undefined when all do.
  const Tensor& rows(std::int64_t item) const { return rows_[static_cast<std::size_t>(item)]; }

 private:
  std::vector<Tensor> rows_;
  std::int64_t keys_ = 0;
};

/// softmax(q kᵀ / √d) v over the keys that count. Scores are never held whole (nn::blocked_attention), and keys that do
/// not count are left out before, which is the same and costs nothing.
/// @param q [B, H, N, d] @param k, v [B, H, S, d] @return [B, H, N, d]
/// @throws InputError when the mask has another number of items or keys
Tensor masked_attention(const Tensor& q, const Tensor& k, const Tensor& v, const KeyMask& mask = {});

/// Self attention with keys `c_qkv.*` and `c_proj.*`. Head h owns rows 3dh … 3d(h+1) of c_qkv: its q, then k, then v
/// (docs/reference/anymate.md, 2.1), unlike nn::DenseAttention.
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

/// Attention with keys `wq.*`, `wk.*`, `wv.*`, `proj.*`; head j owns channels jd … (j+1)d of each
/// (docs/reference/anymate.md, 3.4).
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

inline constexpr double kNormEps = 1e-5;  ///< of every layer norm (docs/reference/anymate.md, 2.1)

/// Linear · GELU in its exact (erf) form · Linear, under the names given.
class ErfMlpImpl : public torch::nn::Module {
 public:
  ErfMlpImpl(std::int64_t in, std::int64_t hidden, std::int64_t out, const std::string& first = "c_fc",
             const std::string& second = "c_proj");
  /// @param x [..., in] @return [..., out]
  Tensor forward(const Tensor& x) { return second_(nn::gelu_erf(first_(x))); }

 private:
  nn::Linear first_ = nullptr, second_ = nullptr;
};
TORCH_MODULE(ErfMlp);

/// Pre-norm self-attention block ("RAB", docs/reference/anymate.md, 2.1): x += attn(ln_1 x), x += mlp(ln_2 x), with
/// hidden width 4W. Keys `attn.{c_qkv,c_proj}`, `ln_1`, `ln_2`, `mlp.{c_fc,c_proj}`.
class ResidualAttentionImpl : public torch::nn::Module {
 public:
  ResidualAttentionImpl(std::int64_t width, std::int64_t heads, bool qkv_bias);
  /// Rows that the mask hides as keys are still computed. @param x [B, N, W] @return [B, N, W]
  Tensor forward(const Tensor& x, const KeyMask& mask = {});

 private:
  InterleavedSelfAttention attention_ = nullptr;
  nn::AffineLayerNorm ln_1_ = nullptr, ln_2_ = nullptr;
  ErfMlp mlp_ = nullptr;
};
TORCH_MODULE(ResidualAttention);

/// Pre-norm cross-attention block ("RCAB"): x += attn(ln_1 x, ln_2 data), x += mlp(ln_3 x). Keys
/// `attn.{c_q,c_kv,c_proj}`, `ln_1`, `ln_2`, `ln_3`, `mlp.{c_fc,c_proj}`.
class ResidualCrossAttentionImpl : public torch::nn::Module {
 public:
  /// @param data_width of what is attended to; 0: the width
  ResidualCrossAttentionImpl(std::int64_t width, std::int64_t heads, bool qkv_bias, std::int64_t data_width = 0);
  /// @param x [B, N, W] @param data [B, M, D] @param mask of the M keys @return [B, N, W]
  Tensor forward(const Tensor& x, const Tensor& data, const KeyMask& mask = {});

 private:
  InterleavedCrossAttention attention_ = nullptr;
  nn::AffineLayerNorm ln_1_ = nullptr, ln_2_ = nullptr, ln_3_ = nullptr;
  ErfMlp mlp_ = nullptr;
};
TORCH_MODULE(ResidualCrossAttention);

/// Residual attention blocks one after another. Keys `resblocks.<i>.*`.
class ResidualStackImpl : public torch::nn::Module {
 public:
  ResidualStackImpl(std::int64_t layers, std::int64_t width, std::int64_t heads, bool qkv_bias);
  Tensor forward(Tensor x, const KeyMask& mask = {});  ///< @param x [B, N, W] @return [B, N, W]

 private:
  std::vector<ResidualAttention> blocks_;
};
TORCH_MODULE(ResidualStack);

/// Widths of the two streams of a read-compute-write denoiser: a few latents z that think, many points x that are read
/// and written (Jabri et al. 2023, "Scalable Adaptive Computation for Iterative Generation"; docs/reference/anymate.md,
/// 3.4).
struct ReadWriteOptions {
  std::int64_t z_dim = 768, x_dim = 512, num_heads = 8;
  double mlp_ratio = 4.0;
  bool qkv_bias = true;
};

/// Update of one stream: a += attn(norm_a1 a, norm_b b), a += mlp(norm_a2 a). Reads latents from points (a = z, b = x),
/// writes them back (a = x, b = z), or computes among latents, where norm_a1 serves both sides. Keys `norm_<b>`,
/// `norm_<a>1`, `attn.*`, `norm_<a>2`, `mlp.{fc1,fc2}`.
class StreamBlockImpl : public torch::nn::Module {
 public:
  /// @param to, from "z" or "x"
  StreamBlockImpl(const ReadWriteOptions& options, const std::string& to, const std::string& from);
  Tensor forward(const Tensor& a,
                 const Tensor& b);  ///< @param a [B, M, dim of to] @param b [B, N, dim of from] @return a

 private:
  nn::AffineLayerNorm norm_from_ = nullptr, norm_1_ = nullptr, norm_2_ = nullptr;
  SeparateAttention attention_ = nullptr;
  ErfMlp mlp_ = nullptr;
};
TORCH_MODULE(StreamBlock);

/// One read, several computes, one write. Keys `read.*`, `write.*`, `compute.<i>.*`.
class ReadComputeWriteImpl : public torch::nn::Module {
 public:
  ReadComputeWriteImpl(const ReadWriteOptions& options, std::int64_t compute_layers);
  void forward(Tensor& z, Tensor& x);  ///< both are replaced

 private:
  StreamBlock read_ = nullptr, write_ = nullptr;
  std::vector<StreamBlock> compute_;
};
TORCH_MODULE(ReadComputeWrite);

/// Self attention with keys `qkv.weight` (rows q, k, v, no bias; head j owns channels jd … of each) and `proj.*`.
class VitAttentionImpl : public torch::nn::Module {
 public:
  VitAttentionImpl(std::int64_t width, std::int64_t heads);
  Tensor forward(const Tensor& x);  ///< @param x [B, N, W] @return [B, N, W]

 private:
  std::int64_t heads_;
  nn::Linear qkv_ = nullptr, proj_ = nullptr;
};
TORCH_MODULE(VitAttention);

/// Pre-norm block of a vision transformer with stochastic depth (Huang et al. 2016): while training each branch of each
/// item is left out with a probability, and scaled up otherwise. Keys `norm1`, `attn.*`, `norm2`, `mlp.{fc1,fc2}`.
class VitBlockImpl : public torch::nn::Module {
 public:
  /// @param drop_path probability, in [0, 1)
  VitBlockImpl(std::int64_t width, std::int64_t heads, double drop_path);
  Tensor forward(const Tensor& x);  ///< @param x [B, N, W] @return [B, N, W]

 private:
  Tensor kept(const Tensor& branch) const;

  double drop_path_;
  nn::AffineLayerNorm norm1_ = nullptr, norm2_ = nullptr;
  VitAttention attention_ = nullptr;
  ErfMlp mlp_ = nullptr;
};
TORCH_MODULE(VitBlock);

/// PyTorch's default for every nn::Linear and PointwiseConv below `module`, weight and bias uniform in ± 1 / sqrt(fan
/// in), and ones and zeros for its layer norms: what the released modules start with where they say nothing else.
void default_layers(torch::nn::Module& module);

/// N(0, std²) weights and zero biases for the linear maps inside every residual attention block at or below `module`
/// (docs/reference/anymate.md, 2.1). Call it after default_layers.
void normal_blocks(torch::nn::Module& module, double std);

/// Both, where initial values are wanted.
void start_blocks(torch::nn::Module& module, double std, nn::Init init);

/// @param what the argument that is wrong @throws InputError unless the condition holds
void require(bool condition, const std::string& what, const std::string& problem);

/// @param shape the sizes wanted, -1 for any @throws InputError naming the tensor and both shapes
void require_shape(const Tensor& tensor, const std::vector<std::int64_t>& shape, const std::string& what);

}  // namespace anigen::anymate
