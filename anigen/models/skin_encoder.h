#pragma once
#include <vector>

#include "anigen/models/joint_embedder.h"
#include "anigen/models/skeleton_batch.h"
#include "anigen/models/skin_autoencoder_options.h"
#include "anigen/nn/fourier_embedding.h"

namespace anigen::models {

/// Encodes skeletons into one feature per joint, and skin weights at any surface points into one feature per point
/// (paper 3.3.1; reference autoencoders.md, 1.1). Under `skin_encoder` in SkinAE and structured-latent checkpoints.
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

}  // namespace anigen::models
