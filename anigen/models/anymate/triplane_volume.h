#pragma once
#include <optional>

#include "anigen/models/anymate/joint_volume.h"
#include "anigen/models/anymate/style_generator.h"
#include "anigen/nn/init.h"

namespace anigen::models::anymate {

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

/// The field by three planes of features that a generator makes of one vector ("triplane", reference
/// anymate-baselines.md, 3.7). Keys `backbone.*` (StyleGenerator), `decoder.net.*`. Planes are made once while
/// nn::KeptContexts lives and no gradient is recorded.
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

}  // namespace anigen::models::anymate
