#pragma once
#include <optional>
#include <vector>

#include "anigen/anymate/blocks.h"
#include "anigen/anymate/heads.h"
#include "anigen/anymate/style.h"
#include "anigen/nn/init.h"
#include "anigen/nn/torch.h"

namespace anigen::anymate {

inline constexpr std::int64_t kVolumeSide = 64;             ///< cells of the grid of occupied voxels
inline constexpr std::int64_t kMostTrainingVoxels = 50000;  ///< of one item in a training step

/// A field over space that is high at joints, asked about at points. Points do not influence each other.
class JointVolumeImpl : public torch::nn::Module {
 public:
  /// @param latents what the encoder gives for this decoder: [B, L, W], or [B, W] for the tri-plane
  /// @param queries [B, V, 3] in [-1, 1] @return [B, V, 1] logits @throws InputError for shapes
  virtual Tensor forward(const Tensor& latents, const Tensor& queries) = 0;
};

/// Query points of an item's field: the lower corner of each occupied cell, i / 32 - 1 (docs/reference/anymate.md, 1.4
/// and 3.5). @param voxels [V, 3] integers in [0, 64) @return [V, 3] fp32
/// @throws InputError for another shape or an index outside
Tensor voxel_corners(const Tensor& voxels);

/// At most `most` rows, drawn from torch's default generator; all of them, in order, when there are no more.
Tensor training_voxels(const Tensor& voxels, std::int64_t most = kMostTrainingVoxels);

/// exp(-d² / 2σ²) of the distance d to the nearest joint, σ = 1/32, one cell.
/// @param queries [V, 3] @param joints [J, 3], J > 0 @return [V] @throws InputError
Tensor joint_heat(const Tensor& queries, const Tensor& joints);

/// Mean over items of the binary cross entropy between the field and joint_heat, each the mean over its voxels.
/// @param voxels of each item [V, 3] @param joints of each item [J, 3] @throws InputError when numbers of items differ
Tensor joint_volume_loss(JointVolumeImpl& model, const Tensor& latents, const std::vector<Tensor>& voxels,
                         const std::vector<Tensor>& joints);

/// The field of one item at all of its voxels, `chunk` at a time (the same as all at once), without gradients.
/// @param latents [1, ...] @return [V, 1] logits
Tensor joint_volume(JointVolumeImpl& model, const Tensor& latents, const Tensor& voxels, std::int64_t chunk = 16384);

/// Joints from a field (docs/reference/anymate.md, 3.5): cells above a level fall into clusters of neighbours (26 of
/// them); as long as a cluster has ten cells or more, its lower values are cut away and what remains is clustered
/// again. A cluster of equal values, for which the released program never ends, is left as it is.
/// @param logits [V] or [V, 1] @param voxels [V, 3] integers in [0, 64); of a cell named twice the last value counts
/// @return [K, 3] fp64, mean corner of each cluster, clusters by their first cell in x, y, z order
/// @throws InputError for shapes, indices outside and values that are not finite
Tensor joint_key_points(const Tensor& logits, const Tensor& voxels);

/// The field as a function of the position ("implicit_transformer", docs/reference/anymate.md, 3.6): each query attends
/// to the latents once. Keys `query_proj.*`, `cross_attn_decoder.*`, `ln_post.*`, `output_proj.*`.
class ImplicitVolumeImpl : public JointVolumeImpl {
 public:
  explicit ImplicitVolumeImpl(const HeadOptions& options = {}, nn::Init init = nn::Init::kPublished);
  Tensor forward(const Tensor& latents, const Tensor& queries) override;

 private:
  HeadOptions options_;
  nn::Linear query_proj_ = nullptr, output_proj_ = nullptr;
  ResidualCrossAttention cross_attn_decoder_ = nullptr;
  nn::AffineLayerNorm ln_post_ = nullptr;
};
TORCH_MODULE(ImplicitVolume);

inline constexpr std::int64_t kPlaneChannels = 32;  ///< of each of the three planes

/// The planes of a tri-plane (Chan et al. 2022, "EG3D"): rows of plane p are its axes, of which the first is its width
/// and the second its height: x and y, x and z, z and x. @return [3, 3, 3]
Tensor triplane_axes();

/// Features of points on each plane, bilinear, zero outside. @param planes [B, 3, C, R, R] @param queries [B, V, 3] in
/// [-1, 1] @return [B, 3, V, C] @throws InputError for shapes
Tensor sample_planes(const Tensor& planes, const Tensor& queries);

/// From the mean over planes to a logit: 32 → 64 · softplus · 64 → 1. Keys `net.0.*`, `net.2.*`.
class PlaneHeadImpl : public torch::nn::Module {
 public:
  PlaneHeadImpl();
  Tensor forward(const Tensor& sampled);  ///< @param sampled [B, 3, V, 32] @return [B, V, 1]
  void initialize();

 private:
  EqualizedLinear first_ = nullptr, second_ = nullptr;
};
TORCH_MODULE(PlaneHead);

/// The field by three planes of features that a generator makes of one vector ("triplane", docs/reference/anymate.md,
/// 3.7). Keys `backbone.*` (StyleGenerator), `decoder.net.*`. Planes are made once while nn::ConditionCache lives and
/// no gradient is recorded.
class TriplaneVolumeImpl : public JointVolumeImpl {
 public:
  /// @param options img_channels are set to those of three planes
  explicit TriplaneVolumeImpl(const StyleGeneratorOptions& options = {}, nn::Init init = nn::Init::kPublished);
  Tensor forward(const Tensor& latents, const Tensor& queries) override;  ///< @param latents [B, z_dim]

  Tensor styles(const Tensor& z);  ///< [B, num_ws, w_dim]
  /// @param noise unset: random while training, the stored maps in evaluation, where the released code draws too
  /// @return [B, 3, 32, R, R]
  Tensor planes(const Tensor& z, std::optional<StyleNoise> noise = std::nullopt);
  Tensor logits(const Tensor& planes, const Tensor& queries) { return decoder_(sample_planes(planes, queries)); }
  Tensor decoded(const Tensor& sampled) { return decoder_(sampled); }  ///< @param sampled [B, 3, V, 32]

 private:
  StyleGenerator backbone_ = nullptr;
  PlaneHead decoder_ = nullptr;
};
TORCH_MODULE(TriplaneVolume);

}  // namespace anigen::anymate
