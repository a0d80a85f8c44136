#pragma once
#include <vector>

#include "anigen/anymate/blocks.h"
#include "anigen/nn/init.h"
#include "anigen/nn/torch.h"

namespace anigen::anymate {

/// Farthest-point sampling (Eldar et al. 1997): again and again the point whose squared distance to those chosen is
/// largest, of equal ones the first. On the CPU, one thread an item.
/// @param points [B, N, 3] fp32 @param count at most N @param start [B] int64, the first choice of each item
/// @return [B, count] int64, on the device of the points
/// @throws InputError for shapes, for more points than there are, and for a start that is no point
Tensor farthest_points(const Tensor& points, std::int64_t count, const Tensor& start);

/// The `count` nearest points of each centre, in no order. Distances are formed as |a|² - 2ab + |b|², as the released
/// code does, which decides between near ties. One item at a time, so that no [B, G, N] is held.
/// @param points [B, N, 3] @param centers [B, G, 3] @return [B, G, count] int64
/// @throws InputError for shapes and for more points than there are
Tensor nearest_points(const Tensor& points, const Tensor& centers, std::int64_t count);

/// Convolution with a kernel of one, over values whose channels come last: a linear map with `weight` [out, in, 1] and
/// `bias` [out], as the state dict of a Conv1d has them. Not initialised.
class PointwiseConvImpl : public torch::nn::Module {
 public:
  PointwiseConvImpl(std::int64_t in, std::int64_t out);
  /// @param x [..., in] @return [..., out]
  Tensor forward(const Tensor& x);

  Tensor weight, bias;
};
TORCH_MODULE(PointwiseConv);

/// Encoder of a group of points (Yu et al. 2022, "Point-BERT", after PointNet; docs/reference/anymate.md, 2.2): each
/// point through two layers, the maximum over the group beside each, two more layers, the maximum again. Batch norms
/// take statistics over all points while training and their running ones in evaluation. Keys `first_conv.{0,1,3}` and
/// `second_conv.{0,1,3}`, of which 1 is the norm.
class MiniPointNetImpl : public torch::nn::Module {
 public:
  MiniPointNetImpl(std::int64_t in, std::int64_t out);
  Tensor forward(const Tensor& groups);  ///< @param groups [B, G, M, in] @return [B, G, out]

 private:
  Tensor second_layer(const Tensor& each, const Tensor& whole);

  PointwiseConv conv1_ = nullptr, conv2_ = nullptr, conv3_ = nullptr, conv4_ = nullptr;
  torch::nn::BatchNorm1d norm1_ = nullptr, norm2_ = nullptr;
};
TORCH_MODULE(MiniPointNet);

/// Arguments of the released encoder ("PointTransformer_8192point_2layer") under their own names.
struct PointBertOptions {
  std::int64_t trans_dim = 384, depth = 12, num_heads = 6;
  std::int64_t group_size = 32, num_group = 512;
  std::int64_t encoder_dims = 256;  ///< of a group before it becomes a token
  std::int64_t point_dims = 6;      ///< position and colour
  double drop_path_rate = 0.1;      ///< of the last block, while training
};

/// Groups of a point cloud.
struct PointGroups {
  Tensor centers;  ///< [B, G, 3]
  Tensor rows;     ///< [B, G, M] int64, members of each group, in no order
  Tensor points;   ///< [B, G, M, point_dims], positions relative to the centre, then what else a point has
};

/// Point-BERT (Yu et al. 2022) with the layout of PointLLM, which Anymate starts from (docs/reference/anymate.md, 2.2).
/// Keys `cls_token`, `cls_pos`, `encoder.*` (MiniPointNet), `reduce_dim.*`, `pos_embed.{0,2}.*`, `blocks.blocks.<i>.*`,
/// `norm.*`.
class PointBertImpl : public torch::nn::Module {
 public:
  explicit PointBertImpl(const PointBertOptions& options = {}, nn::Init init = nn::Init::kPublished);

  /// @param points [B, N, 3 or more], positions in [-1, 1]; further channels (normals) are not used
  /// @param start [B] int64, the first point that becomes a centre. Undefined: drawn from torch's default generator
  ///   while training, point 0 in evaluation, where the released code draws too
  /// @return [B, 1 + G, trans_dim], the class token first @throws InputError for other shapes and too few points
  Tensor forward(const Tensor& points, const Tensor& start = {});

  /// The steps of forward.
  PointGroups grouped(const Tensor& points, const Tensor& start = {}) const;
  Tensor group_features(const PointGroups& groups) { return encoder_(groups.points); }  ///< [B, G, encoder_dims]
  /// @param features of group_features @return [B, 1 + G, trans_dim]
  Tensor tokens(const PointGroups& groups, const Tensor& features);

  std::int64_t token_count() const { return options_.num_group + 1; }

 private:
  PointBertOptions options_;
  Tensor cls_token_, cls_pos_;
  MiniPointNet encoder_ = nullptr;
  nn::Linear reduce_dim_ = nullptr;
  ErfMlp pos_embed_ = nullptr;
  std::vector<VitBlock> blocks_;
  nn::AffineLayerNorm norm_ = nullptr;
};
TORCH_MODULE(PointBert);

struct PerceiverOptions {
  std::int64_t num_latents = 16;  ///< learned queries, and so tokens that come out
  std::int64_t features = 3;      ///< channels of a point beside the Fourier features of its position
  std::int64_t width = 768, heads = 12, layers = 8;
  std::int64_t num_freqs = 8;
  bool include_pi = true, qkv_bias = true;
  bool ln_post = false;  ///< a layer norm at the end
};

/// Points to a few tokens (Jaegle et al. 2021, "Perceiver"; docs/reference/anymate.md, 2.3 and 2.4): learned queries
/// attend to all points once, then to each other. Keys `query` [M, W], `input_proj.*`, `cross_attn.*`,
/// `self_attn.resblocks.<i>.*` and, if asked for, `ln_post.*`. Parameters are not initialised here.
class PerceiverEncoderImpl : public torch::nn::Module {
 public:
  explicit PerceiverEncoderImpl(const PerceiverOptions& options);
  /// @param positions [B, N, 3] @param features [B, N, features] @return [B, M, W]
  Tensor forward(const Tensor& positions, const Tensor& features);

  Tensor query;

 private:
  PerceiverOptions options_;
  nn::Linear input_proj_ = nullptr;
  ResidualCrossAttention cross_attn_ = nullptr;
  ResidualStack self_attn_ = nullptr;
  nn::AffineLayerNorm ln_post_ = nullptr;
};
TORCH_MODULE(PerceiverEncoder);

/// Arguments of the released shape encoder ("shapevae-256") under their own names.
struct MichelangeloOptions {
  std::int64_t num_latents = 256;  ///< without the class token
  std::int64_t embed_dim = 64;     ///< of the bottleneck
  std::int64_t point_feats = 3;    ///< normals; their harmonics are added to them
  std::int64_t num_freqs = 8;
  bool include_pi = false;  ///< unlike all other modules
  std::int64_t width = 768, heads = 12, num_encoder_layers = 8, num_decoder_layers = 16;
  bool use_ln_post = true, qkv_bias = false;
  double init_scale = 0.25;
  bool only_embed = false;  ///< what the tri-plane decoder needs: no bottleneck and no decoder
};

/// Intermediate results of the encoder.
struct MichelangeloCode {
  Tensor shape_embed;         ///< [B, W], the class token in the space of pictures and text
  Tensor shape_latents;       ///< [B, M, W], before the bottleneck
  Tensor kl_mean, kl_logvar;  ///< [B, M, E]; the latter within [-30, 20]
  Tensor latents;             ///< [B, M, W], decoded from the sample
  Tensor tokens() const { return torch::cat({shape_embed.unsqueeze(1), latents}, 1); }  ///< [B, 1 + M, W]
};

/// The shape encoder of Michelangelo (Zhao et al. 2023) as Anymate widened it: 25 harmonics of the normal as further
/// input (docs/reference/anymate.md, 2.3). Keys `shape_projection`, `encoder.*` (PerceiverEncoder), `pre_kl.*`,
/// `post_kl.*`, `transformer.resblocks.<i>.*`; with only_embed the first two alone.
class MichelangeloEncoderImpl : public torch::nn::Module {
 public:
  explicit MichelangeloEncoderImpl(const MichelangeloOptions& options = {}, nn::Init init = nn::Init::kPublished);

  /// @param points [B, N, 6], positions in [-1, 1] and unit normals
  /// @param noise [B, M, E] standard normal draws for the sample of the bottleneck. Undefined: drawn from torch's
  ///   default generator while training, none (the mean) in evaluation, where the released code draws too
  /// @return [B, 1 + M, W]; with only_embed [B, W] @throws InputError for other shapes
  Tensor forward(const Tensor& points, const Tensor& noise = {});
  /// Forward pass with its intermediate results. @throws InputError with only_embed
  MichelangeloCode encode(const Tensor& points, const Tensor& noise = {});
  Tensor shape_embed(const Tensor& points);  ///< [B, W]

 private:
  Tensor perceived(const Tensor& points);

  MichelangeloOptions options_;
  Tensor shape_projection_;
  PerceiverEncoder encoder_ = nullptr;
  nn::Linear pre_kl_ = nullptr, post_kl_ = nullptr;
  ResidualStack transformer_ = nullptr;
};
TORCH_MODULE(MichelangeloEncoder);

struct ScratchEncoderOptions {
  std::int64_t num_latents = 16, width = 768, heads = 12, num_encoder_layers = 8, num_freqs = 8;
  double init_scale = 0.25;
};

/// The point encoder that the released diffusion config trains from random weights (docs/reference/anymate.md, 2.4): a
/// perceiver over positions and normals, all maps with biases. Keys `encoder.*` (PerceiverEncoder).
class ScratchEncoderImpl : public torch::nn::Module {
 public:
  explicit ScratchEncoderImpl(const ScratchEncoderOptions& options = {}, nn::Init init = nn::Init::kPublished);
  /// @param points [B, N, 6], positions in [-1, 1] and unit normals @return [B, M, W]
  Tensor forward(const Tensor& points);

 private:
  PerceiverEncoder encoder_ = nullptr;
};
TORCH_MODULE(ScratchEncoder);

struct ProjectionWidths {
  std::int64_t in = 384, hidden_1 = 512, hidden_2 = 512, out = 768;
};

/// Point-BERT's tokens in the width of the decoders (docs/reference/anymate.md, 2.2): Linear · GELU · Linear · GELU ·
/// Linear. Keys `0.*`, `2.*`, `4.*`.
class TokenProjectionImpl : public torch::nn::Module {
 public:
  explicit TokenProjectionImpl(const ProjectionWidths& widths);
  Tensor forward(const Tensor& tokens);  ///< @param tokens [B, T, in] @return [B, T, out]

 private:
  nn::Linear first_ = nullptr, second_ = nullptr, third_ = nullptr;
};
TORCH_MODULE(TokenProjection);

/// Latents as above, and a learned weighted sum of the tokens after it, for decoders of one vector. Keys `0.{0,2,4}.*`
/// and `1.{weight [1, T], bias}`.
class PooledProjectionImpl : public torch::nn::Module {
 public:
  PooledProjectionImpl(const ProjectionWidths& widths, std::int64_t tokens);
  Tensor forward(const Tensor& tokens);  ///< @param tokens [B, T, in] @return [B, out]

 private:
  TokenProjection each_ = nullptr;
  nn::Linear sum_ = nullptr;
};
TORCH_MODULE(PooledProjection);

}  // namespace anigen::anymate
