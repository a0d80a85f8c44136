#pragma once
#include "anigen/models/anymate/head_options.h"
#include "anigen/nn/linear.h"

namespace anigen::models::anymate {

using torch::Tensor;

/// What a skinning head looks at.
struct SkinningInput {
  Tensor latents;  ///< [B, L, W]
  Tensor points;   ///< [B, N, 6], positions in [-1, 1] and unit normals: of surface samples or of vertices
  Tensor bones;    ///< [B, K or more, 6], head and tail in [-1, 1], padded
  Tensor mask;     ///< [B, K], not zero for real bones; undefined: all of them are
};

/// Logits of each bone at each point; the softmax over bones gives the skin weights. Masked bones get -1e8.
class SkinningImpl : public torch::nn::Module {
 public:
  /// @param chunk points at a time, 0: as many as the head thinks best. The result does not depend on it.
  /// @return [B, N, K] @throws InputError for shapes
  virtual Tensor forward(const SkinningInput& input, std::int64_t chunk = 0) = 0;
};

/// Points and bones as tokens (reference anymate-baselines.md, 5.1). Not a module: registers its maps in the head, with
/// the keys `bone_proj.*`, and `co_proj.*` and `normal_proj.*` or, as the option `separate` has it, `pc_proj.*`.
class SkinningEmbedding {
 public:
  SkinningEmbedding() = default;
  SkinningEmbedding(torch::nn::Module& head, const HeadOptions& options, bool separate);
  Tensor points(const Tensor& points);  ///< @param points [B, N, 6] @return [B, N, W]
  Tensor bones(const Tensor& bones);    ///< @param bones [B, K, 6] @return [B, K, W]

 private:
  std::int64_t num_freqs_ = 0;
  nn::Linear bone_proj_ = nullptr, co_proj_ = nullptr, normal_proj_ = nullptr, pc_proj_ = nullptr;
};

/// The bones that the mask speaks of, [B, K, 6], after a check of all shapes. @throws InputError
Tensor checked_bones(const SkinningInput& input, std::int64_t width);

/// Logits with -1e8 for bones that the mask leaves out. @param logits [B, N, K]
Tensor masked_bone_logits(const Tensor& logits, const Tensor& mask);

/// `count` of `points` indices in random order, from torch's default generator: the subset that a training step takes,
/// the same for all items of a batch (1,024 of 8,192 as released). @return [count] int64 @throws InputError
Tensor training_points(std::int64_t points, std::int64_t count = 1024);

/// For heads that know sampled points only: each vertex gets the logits of the nearest point, of equally near ones the
/// first. @param vertices [V, 3] @param points [N, 3] @param logits [N, K] @return [V, K] @throws InputError
Tensor nearest_point_logits(const Tensor& vertices, const Tensor& points, const Tensor& logits);

/// Losses over bones, means over all points of a batch (reference anymate-baselines.md, 5 and 6.4). The softmax is
/// taken in the dtype of the logits, everything else in the wider dtype of the two.
struct SkinningLosses {
  Tensor cos;        ///< 1 - cosine of softmax and truth
  Tensor cos_clamp;  ///< the same of clamp(1.002 softmax - 0.001, 0, 1): the released training loss
  Tensor ce;         ///< - Σ truth ln(softmax + 1e-6)
};
/// @param logits, truth [B, N, K]; rows of the truth need not sum to 1 @throws InputError for shapes
SkinningLosses skinning_losses(const Tensor& logits, const Tensor& truth);

}  // namespace anigen::models::anymate
