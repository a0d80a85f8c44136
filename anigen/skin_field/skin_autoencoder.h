#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/nn/blocks.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/init.h"
#include "anigen/nn/ragged_attention.h"
#include "anigen/nn/trainable.h"
#include "anigen/skin_field/sampling.h"

namespace anigen::skin_field {

/// Arguments `jp_embedder_config` of the skin encoder (docs/reference/autoencoders.md, 2 and 2.1).
struct JointEmbedderOptions {
  std::int64_t hidden_dim = 0;  ///< H; 0 means jp_embed_dim
  std::int64_t depth = 4;       ///< D
  bool jp_embed_attn =
      true;                ///< blocks attend over the joints; false: each is an FFN that re-adds the embedder's input
  double mlp_ratio = 4.0;  ///< of the input layer and of the blocks

  void fields(ConfigFields& f);
};

/// Arguments `encoder_config` (and `skin_encoder_config` of the structured-latent encoder).
struct SkinEncoderOptions : JsonOptions<SkinEncoderOptions> {
  std::int64_t skin_feat_channels = 8;   ///< F
  std::int64_t skl_pos_embed_freq = 10;  ///< n, bands of the Fourier embedding
  std::int64_t jp_embed_dim = 128;       ///< E
  JointEmbedderOptions jp_embedder_config;
  bool relative_pe = true;          ///< embed joints relative to their parents
  bool vert_feat_is_linear = true;  ///< weights times embeddings; false: the head runs after the weighting
  bool normalize_feat = true;       ///< joint embeddings on the unit sphere

  void fields(ConfigFields& f);
  void validate(const std::string& file = "", const std::string& pointer = "") const;
  std::int64_t hidden_dim() const {
    return jp_embedder_config.hidden_dim > 0 ? jp_embedder_config.hidden_dim : jp_embed_dim;
  }
};

/// Arguments `decoder_config` (and `skin_decoder_config` of the structured-latent decoder).
struct SkinDecoderOptions : JsonOptions<SkinDecoderOptions> {
  std::string model_type = "tree";      ///< the only one that exists
  std::int64_t skin_feat_channels = 8;  ///< F
  std::int64_t model_channels = 512;    ///< M
  std::int64_t num_blocks = 4;
  std::int64_t num_heads = 4;
  std::int64_t vert_cross_blocks_num = 0;  ///< the first so many vertex blocks cross-attend to the joints

  void fields(ConfigFields& f);
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

/// Arguments of the published class SkinAutoEncoder; defaults are those of the class, not of its config.
struct SkinAutoEncoderOptions : JsonOptions<SkinAutoEncoderOptions> {
  SkinEncoderOptions encoder_config;
  SkinDecoderOptions decoder_config;
  bool use_fp16 =
      false;  ///< the decoder's blocks in fp16; the joint embedder's blocks always are (see SkinAutoEncoder)

  void fields(ConfigFields& f);
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

inline constexpr std::int64_t kJointEmbedderHeads = 8;  ///< fixed, whatever the hidden width

/// Turns the embedded pair (joint, parent) of each joint into its embedding, by attention over the joints of its asset
/// or, with jp_embed_attn off, joint by joint (docs/reference/autoencoders.md, 2.1).
class JointEmbedderImpl : public torch::nn::Module {
 public:
  JointEmbedderImpl(std::int64_t in_channels, std::int64_t hidden_dim, std::int64_t out_channels,
                    const JointEmbedderOptions& options);

  /// @param pairs [ΣJ, in_channels] @return [ΣJ, out_channels]
  torch::Tensor forward(const torch::Tensor& pairs, const nn::Ragged& items);

 private:
  torch::Tensor run_blocks(const torch::Tensor& first, const nn::Ragged& items);

  nn::FeedForward in_layer_ = nullptr;
  std::vector<nn::TransformerBlock> attention_blocks_;  ///< one of the two lists is in use
  std::vector<nn::FeedForward> plain_blocks_;
  nn::Linear out_layer_ = nullptr;
};
TORCH_MODULE(JointEmbedder);

/// Encodes skeletons into one feature per joint, and skin weights at any surface points into one feature per point
/// (paper 3.3.1; docs/reference/autoencoders.md, 2.1). Under `skin_encoder` in SkinAE and structured-latent
/// checkpoints.
class SkinEncoderImpl : public torch::nn::Module {
 public:
  explicit SkinEncoderImpl(const SkinEncoderOptions& options);

  /// Joint embeddings, which both heads read. @return [ΣJ, E], on the unit sphere with normalize_feat
  torch::Tensor embed_joints(const SkeletonBatch& skeletons);
  /// @param embeddings of embed_joints @return joint features [ΣJ, F]
  torch::Tensor joint_features(const torch::Tensor& embeddings);
  /// Features of surface points from their skin weights.
  /// @param embeddings of embed_joints @param joints its items
  /// @param skin per asset [V, J], rows sum to 1 @return [ΣV, F] @throws InputError naming the asset on a wrong shape
  torch::Tensor vertex_features(const torch::Tensor& embeddings, const nn::Ragged& joints,
                                const std::vector<torch::Tensor>& skin);

  const SkinEncoderOptions& options() const { return options_; }
  /// The published initial values: zero root embedding, Xavier-uniform linears.
  void initialize();

 private:
  SkinEncoderOptions options_;
  nn::FourierEmbedding fourier_;
  torch::Tensor root_embedding_;  ///< [1, E]
  nn::Linear pos_embedder_linear_ = nullptr;
  JointEmbedder joint_embedder_ = nullptr;
  nn::FeedForward out_layer_vert_ = nullptr, out_layer_joint_ = nullptr;
};
TORCH_MODULE(SkinEncoder);

/// Decodes point features and joint features into skin weights: a softmax over the joints of the asset with an inverse
/// temperature learned per point (paper 3.3.1; docs/reference/autoencoders.md, 2.2). Under `skin_decoder` in SkinAE and
/// structured-latent checkpoints.
class SkinDecoderImpl : public torch::nn::Module {
 public:
  explicit SkinDecoderImpl(const SkinDecoderOptions& options);

  /// Logits before the softmax. Points of one asset may come from anywhere: a mesh, samples, a decoded field.
  /// @param vertex_features [ΣV, F] @param vertices points per asset @param joint_features [ΣJ, F]
  /// @param skeletons for parents and items; its joint positions are not read
  /// @return per asset [V, J] fp32
  std::vector<torch::Tensor> logits(const torch::Tensor& vertex_features, const nn::Ragged& vertices,
                                    const torch::Tensor& joint_features, const SkeletonBatch& skeletons);
  /// Number-independent encoding of a skeleton, to which points are compared.
  struct JointKeys {
    std::vector<torch::Tensor> rounds;  ///< [ΣJ, M] before each round with a vertex cross block
    std::vector<torch::Tensor> keys;    ///< per asset [J, M]
    nn::Ragged items{{}};               ///< joints per asset
  };
  /// The joint half of logits(), to be done once when points come in portions.
  JointKeys joint_keys(const torch::Tensor& joint_features, const SkeletonBatch& skeletons);
  /// The point half. @return per asset [V, J] fp32
  std::vector<torch::Tensor> logits(const torch::Tensor& vertex_features, const nn::Ragged& vertices,
                                    const JointKeys& joints);
  /// Skin weights, rows sum to 1. Same arguments as logits.
  std::vector<torch::Tensor> decode(const torch::Tensor& vertex_features, const nn::Ragged& vertices,
                                    const torch::Tensor& joint_features, const SkeletonBatch& skeletons);
  /// Logarithms of the skin weights, finite where the weight itself underflows. Same arguments as logits.
  std::vector<torch::Tensor> decode_log(const torch::Tensor& vertex_features, const nn::Ragged& vertices,
                                        const torch::Tensor& joint_features, const SkeletonBatch& skeletons);

  const SkinDecoderOptions& options() const { return options_; }
  /// The published initial values: zero root features, Xavier-uniform linears.
  void initialize();

 private:
  SkinDecoderOptions options_;
  torch::Tensor root_features_;  ///< [1, F]
  nn::Linear input_layer_vertex_ = nullptr, input_layer_skin_ = nullptr;
  std::vector<nn::CrossBlock> cross_blocks_;    ///< the first vert_cross_blocks_num vertex blocks
  std::vector<nn::FeedForward> vertex_blocks_;  ///< the others; no residual, no norm
  std::vector<nn::TransformerBlock> joint_blocks_;
  nn::Mlp out_layer_vertex_ = nullptr, out_layer_skin_ = nullptr;
};
TORCH_MODULE(SkinDecoder);

/// The skin auto-encoder (paper 3.3.1, "SkinAE"; docs/reference/autoencoders.md, 2). It gives every joint a short
/// feature and every surface point a feature of the same width from which the point's skin weights can be decoded, so
/// that skinning with any number of joints becomes a field of fixed width.
///
/// A batch is treated as one: row-wise layers run once over the joints, or points, of all assets, attention stays
/// inside each asset. Results equal those of one asset at a time up to fp32 rounding.
///
/// Precision: parameters are fp32 and everything is computed in fp32. The published model keeps the joint embedder's
/// blocks, and with use_fp16 the decoder's blocks, in fp16; half_precision_modules() names them, and convert_to_fp16()
/// does the same on a GPU.
class SkinAutoEncoderImpl : public nn::FreezableModel {
 public:
  explicit SkinAutoEncoderImpl(const SkinAutoEncoderOptions& options, nn::Init init = nn::Init::kPublished);

  struct Output {
    std::vector<torch::Tensor> joint_embeds;  ///< per asset [J, F]
    std::vector<torch::Tensor> vert_embeds;   ///< per asset [V, F]
    std::vector<torch::Tensor> skin;          ///< per asset [V, J], rows sum to 1
  };
  /// Encodes and decodes again.
  /// @param joints per asset [J, 3] object space @param parents per asset [J] integers, -1 for roots
  /// @param skin per asset [V, J] weights at any points, rows sum to 1
  /// @throws InputError naming the asset on wrong shapes, parents or values
  Output forward(const std::vector<torch::Tensor>& joints, const std::vector<torch::Tensor>& parents,
                 const std::vector<torch::Tensor>& skin);

  /// Outputs for a training step: log weights per asset [V, J] (see SkinDecoder::decode_log).
  std::vector<torch::Tensor> reconstruct_log(const SkeletonBatch& skeletons, const std::vector<torch::Tensor>& skin);

  struct JointCode {
    torch::Tensor embeddings;  ///< [ΣJ, E], for encode_vertices
    torch::Tensor features;    ///< [ΣJ, F]
  };
  JointCode encode_joints(const SkeletonBatch& skeletons);
  /// @return [ΣV, F]
  torch::Tensor encode_vertices(const JointCode& joints, const SkeletonBatch& skeletons,
                                const std::vector<torch::Tensor>& skin);
  /// @param vertex_features [ΣV, F] @param vertices points per asset @return per asset [V, J]
  std::vector<torch::Tensor> decode(const torch::Tensor& vertex_features, const nn::Ragged& vertices,
                                    const torch::Tensor& joint_features, const SkeletonBatch& skeletons);

  const SkinAutoEncoderOptions& options() const { return options_; }
  SkinEncoder& encoder() { return encoder_; }
  SkinDecoder& decoder() { return decoder_; }

 private:
  SkinAutoEncoderOptions options_;
  SkinEncoder encoder_ = nullptr;
  SkinDecoder decoder_ = nullptr;
};
TORCH_MODULE(SkinAutoEncoder);

/// Rows of each matrix, as items of their concatenation.
nn::Ragged rows_of(const std::vector<torch::Tensor>& matrices);

/// Rescales freshly initialised weights so that signals keep their size through the network. Ours; the published
/// start is Xavier everywhere, with which the decoder's vertex path — four feed-forward layers without residual or norm
/// — shrinks its input about a hundred times, all logits begin equal, and the first hundreds of steps go into undoing
/// that.
///
/// Feed-forward layers: first weights of variance 1/in, second 1/(0.425 · hidden), 0.425 being E[gelu(z)²] of a
/// standard normal z. The two heads behind the unit-length embeddings take the factor sqrt(E) on top, and queries and
/// keys are scaled by M^(-1/4), so that logits begin at a standard deviation of about 2.
void rescale_to_unit_gain(SkinAutoEncoder& model);

}  // namespace anigen::skin_field
