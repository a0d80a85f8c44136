#pragma once
#include <filesystem>

#include "anigen/features/normal_estimator.h"
#include "anigen/models/normal_estimator/picture_normals.h"

namespace anigen::features {

/// The largest picture, its height and width rounded up to multiples of 32: 4096 × 4096.
inline constexpr std::int64_t kMostNormalPixels = std::int64_t{1} << 24;

/// Normals as the published pipeline estimates them: DSINE on the whole picture (models/normal_estimator). Memory on a
/// CPU, measured up to 2048 × 2048: 0.8 GB and 230 bytes for every pixel, which makes 4.7 GB for the largest picture.
///
/// The released weights are not part of this project: users supply their own copy, for non-commercial research only
/// (models/normal_estimator/dsine_weights.h).
class DsineNormals : public NormalEstimator {
 public:
  /// @param weights `dsine.pt`, or the same tensors as .safetensors @throws InputError as models::load_dsine
  explicit DsineNormals(const std::filesystem::path& weights, const torch::Device& device = torch::kCPU);
  /// A network that is filled already, where it is.
  explicit DsineNormals(models::Dsine network);

  /// @throws InputError for a picture of more than kMostNormalPixels
  torch::Tensor normals(const torch::Tensor& rgb) override;

 private:
  models::Dsine network_;
};

}  // namespace anigen::features
