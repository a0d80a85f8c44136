#pragma once
#include <vector>

#include "anigen/fields/skeleton_field.h"
#include "anigen/models/structured_latent_options.h"
#include "anigen/nn/fourier_embedding.h"
#include "anigen/sparse/transformer_block.h"

namespace anigen::models {

/// Linear · SiLU · layer norm (eps 1e-5): tokens of joints. Keys `0.*` and `2.*`.
class JointTokensImpl : public torch::nn::Module {
 public:
  JointTokensImpl(std::int64_t in_channels, std::int64_t channels);
  torch::Tensor forward(const torch::Tensor& x);

 private:
  nn::Linear linear_ = nullptr;
  nn::AffineLayerNorm norm_ = nullptr;
};
TORCH_MODULE(JointTokens);

/// The skin stream attends to the joints of its asset (`skin_cross_from_groupped`; reference autoencoders.md, 3.9). Not
/// a module of its own: registers `root_parent_feat`, `joints_in_proj.*`, `joints_self_attn.{0..3}.*`,
/// `h_skin_coord_proj.*`, `h_skin_coord_fuse.*` and `skin_cross_groupped_net.*` with the model.
class GroupedCross {
 public:
  GroupedCross() = default;
  GroupedCross(torch::nn::Module& model, const StructuredLatentDecoderOptions& options);
  bool present() const { return root_parent_feat_.defined(); }

  /// @param skin the skin stream @param skeletons, features per asset @return the support and dtype of skin
  sparse::SparseTensor forward(const sparse::SparseTensor& skin, const std::vector<fields::SkeletonTensors>& skeletons,
                               const std::vector<fields::JointSkinFeatures>& features);

  void initialize();  ///< the root's feature to zero; layers are the model's to initialise

  /// Names of the modules that are fp16 with use_fp16, for StreamCoder.
  static std::vector<std::string> names();

 private:
  sparse::SparseTensor joint_context(const std::vector<fields::SkeletonTensors>& skeletons,
                                     const std::vector<fields::JointSkinFeatures>& features, torch::Dtype dtype);

  std::int64_t resolution_ = 0;
  nn::FourierEmbedding fourier_{1};
  torch::Tensor root_parent_feat_;  ///< [F]
  JointTokens joint_tokens_ = nullptr;
  std::vector<sparse::SparseTransformerBlock> joint_blocks_;
  nn::Linear place_ = nullptr, fuse_ = nullptr;
  sparse::SparseMultiContextBlock cross_ = nullptr;
};

}  // namespace anigen::models
