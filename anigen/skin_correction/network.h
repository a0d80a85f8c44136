#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/nn/attention.h"
#include "anigen/nn/blocks.h"
#include "anigen/nn/init.h"
#include "anigen/nn/torch.h"
#include "anigen/rigging/skin_features.h"

namespace anigen::skin_correction {

using torch::Tensor;

inline constexpr const char* kSkinCorrectionClass = "SkinCorrection";

/// Arguments of the network, a model of ours.
struct SkinCorrectionOptions : JsonOptions<SkinCorrectionOptions> {
  std::int64_t feature_version = rigging::kSkinFeatureVersion;  ///< of the features that it learns from
  std::int64_t candidates = rigging::kSkinCandidates;           ///< joints per vertex, K
  std::int64_t geovoxel_resolution = 256;                       ///< of the geodesic voxels that it corrects
  std::int64_t members = 8;                                     ///< networks of which the answers are averaged
  std::int64_t width = 32;                                      ///< of each
  std::int64_t num_blocks = 2;
  std::int64_t num_heads = 4;
  double mlp_ratio = 2.0;
  bool sharpening = true;  ///< a learned power of each vertex' weights
  double smoothing = 0.0;  ///< at use alone: share of the mean of its neighbours in each vertex' weights

  void fields(ConfigFields& f);
  void validate(const std::string& file = "", const std::string& pointer = "") const;
  rigging::SkinFeatureOptions features() const;
};

/// Multi-head attention among a few tokens, of which some may be missing.
class TokenAttentionImpl : public nn::AttentionLayers {
 public:
  explicit TokenAttentionImpl(const nn::AttentionOptions& options) : AttentionLayers(options) {}
  /// @param x [N, T, C] @param mask [N, 1, 1, T], added to scores @return [N, T, C]
  Tensor forward(const Tensor& x, const Tensor& mask);
};
TORCH_MODULE(TokenAttention);

/// One network that corrects the classical weights of a vertex on its candidate joints. Each pair of vertex and
/// candidate is a token (rigging/skin_features.h, scaled by skin_feature_scales()); pre-norm blocks attend among the
/// candidates of one vertex and one more token, of the asset. With h and g the weights by heat and by geodesic voxels,
/// and a learned share m of the former,
///
///     w = softmax(e^s (log(m h + (1 − m) g + ε) + c)),
///
/// c the correction of each candidate, s the sharpening of the vertex, ε = rigging::kClassicalFloor. Both are zero at
/// first, and m is 0.88: an untrained network gives a mixture of both classical weights.
class SkinCorrectorImpl : public torch::nn::Module {
 public:
  explicit SkinCorrectorImpl(const SkinCorrectionOptions& options);

  /// @param scaled [N, K, rigging::kSkinPairFeatures] @param heat, geodesic [N, K] weights
  /// @return [N, K] log w @see SkinCorrectionImpl::forward
  Tensor forward(const Tensor& scaled, const Tensor& heat, const Tensor& geodesic, const Tensor& assets,
                 const Tensor& present);
  void start_at_classical_weights();

 private:
  std::int64_t candidates_;
  nn::Mlp pair_ = nullptr, asset_ = nullptr;
  std::vector<TokenAttention> attention_;
  std::vector<nn::FeedForward> mlps_;
  nn::Linear correction_ = nullptr, sharpening_ = nullptr;
  Tensor mixture_;
};
TORCH_MODULE(SkinCorrector);

/// Corrects classical weights by the mean of several networks, which start from different parameters and learn
/// independently of each other: on skeletons that none has seen their errors differ, and their mean is nearer to the
/// truth than each (Lakshminarayanan et al. 2017, Simple and Scalable Predictive Uncertainty Estimation using Deep
/// Ensembles). Order of candidates has no effect. Always fp32.
class SkinCorrectionImpl : public torch::nn::Module {
 public:
  explicit SkinCorrectionImpl(const SkinCorrectionOptions& options, nn::Init init = nn::Init::kPublished);

  /// @param pairs [N, K, rigging::kSkinPairFeatures] fp32 @param assets [N, rigging::kSkinAssetFeatures] fp32
  /// @param present [N, K] bool, false where there is no candidate; one of each row is true
  /// @return [N, K] logarithms of weights, which sum to 1 over the candidates that are present
  /// @throws InputError on another shape
  Tensor forward(const Tensor& pairs, const Tensor& assets, const Tensor& present);

  /// The answer of each network. @param noise added to scaled features, [N, K, rigging::kSkinPairFeatures]; undefined:
  /// none @return [members, N, K] as forward()
  Tensor of_members(const Tensor& pairs, const Tensor& assets, const Tensor& present, const Tensor& noise = {});

  const SkinCorrectionOptions& options() const { return options_; }

 private:
  SkinCorrectionOptions options_;
  std::vector<SkinCorrector> members_;
};
TORCH_MODULE(SkinCorrection);

/// The `most` largest weights of each row, divided by their sum, as binding keeps them. @param weights [N, K]
Tensor strongest_weights(const Tensor& weights, std::int64_t most = 4);

/// Weights by one classical method. @param pairs [N, K, rigging::kSkinPairFeatures]
/// @param feature rigging::kHeatLog or rigging::kGeodesicLog @return [N, K]
Tensor classical_weights(const Tensor& pairs, rigging::SkinPairFeature feature);

}  // namespace anigen::skin_correction
