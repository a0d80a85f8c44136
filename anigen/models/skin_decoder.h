#pragma once
#include <vector>

#include "anigen/models/skeleton_batch.h"
#include "anigen/models/skin_autoencoder_options.h"
#include "anigen/nn/feed_forward.h"
#include "anigen/nn/transformer_block.h"

namespace anigen::models {

/// Decodes point features and joint features into skin weights: a softmax over the joints of the asset with an inverse
/// temperature learned per point (paper 3.3.1; reference autoencoders.md, 1.2). Under `skin_decoder` in SkinAE and
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
  /// What the points of a skeleton are compared with, whatever and however many they are.
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

}  // namespace anigen::models
