#pragma once
#include "anigen/models/anymate/blocks.h"
#include "anigen/models/anymate/skinning.h"
#include "anigen/nn/init.h"

namespace anigen::models::anymate {

/// "attendjoints_combine" (reference anymate-baselines.md, 5.1): points and bones attend to the latents, then to the
/// bones, twice. Points do not see each other, so they can be taken in any chunks, and mesh vertices are asked about
/// directly. Keys `bone_proj` … (SkinningEmbedding), `cross_attn.<i>.*`, `cross_attn_joint.<i>.*`, `q_proj`, `k_proj`,
/// `ln_1`, `ln_2`.
class CrossSkinningImpl : public SkinningImpl {
 public:
  /// @param separate one map for positions and normals together
  explicit CrossSkinningImpl(const HeadOptions& options = {}, std::int64_t layers = 2, bool separate = false,
                             nn::Init init = nn::Init::kPublished);
  /// With chunk 0, all points at once while gradients are recorded, else 8,192 at a time.
  Tensor forward(const SkinningInput& input, std::int64_t chunk = 0) override;

 private:
  /// Bone tokens as each layer offers them to be attended to, and at last after all layers.
  std::vector<Tensor> bone_stream(const Tensor& bones, const Tensor& latents, const KeyMask& keys);

  HeadOptions options_;
  SkinningEmbedding embedding_;
  std::vector<ResidualCrossAttention> cross_attn_, cross_attn_joint_;
  nn::Linear q_proj_ = nullptr, k_proj_ = nullptr;
  nn::AffineLayerNorm ln_1_ = nullptr, ln_2_ = nullptr;
};
TORCH_MODULE(CrossSkinning);

struct ConcatSkinningOptions {
  std::int64_t layers = 4;
  std::int64_t concat_num = 512;  ///< points that go through the transformer together
  bool separate = false;          ///< one map for positions and normals together
  /// The released code lays masks out run after run and sequences item after item, so that in a batch of several items
  /// run c of item b hides the bones of item (b · runs + c) mod B. True computes that too; false gives every item its
  /// own mask. The same for one item, and for items with equally many bones.
  bool tiled_masks = false;
};

/// "attendjoints_multi" (reference anymate-baselines.md, 5.2): each run of concat_num points goes through one
/// transformer together with all bones and latents. Runs are part of what the model means, so there must be a whole
/// number of them; mesh vertices take the logits of the nearest point (nearest_point_logits). Keys
/// `self_attn.resblocks.<i>.*`, `bone_proj` … (SkinningEmbedding), `output_proj_joints`, `output_proj_points`,
/// `layer_norm`.
class ConcatSkinningImpl : public SkinningImpl {
 public:
  explicit ConcatSkinningImpl(const HeadOptions& head = {}, const ConcatSkinningOptions& options = {},
                              nn::Init init = nn::Init::kPublished);
  /// @param chunk a multiple of concat_num; 0: one run at a time @throws InputError also when runs are not whole
  Tensor forward(const SkinningInput& input, std::int64_t chunk = 0) override;

 private:
  /// @param points [B, r · concat_num, W] tokens @param masks [B, r, K] of each run, or undefined
  /// @return [B, r · concat_num, K]
  Tensor run_logits(const Tensor& points, const Tensor& bones, const Tensor& latents, const Tensor& masks);

  HeadOptions head_;
  ConcatSkinningOptions options_;
  SkinningEmbedding embedding_;
  ResidualStack self_attn_ = nullptr;
  nn::Linear output_proj_joints_ = nullptr, output_proj_points_ = nullptr;
  nn::AffineLayerNorm layer_norm_ = nullptr;
};
TORCH_MODULE(ConcatSkinning);

}  // namespace anigen::models::anymate
