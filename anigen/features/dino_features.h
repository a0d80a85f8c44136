#pragma once
#include <filesystem>
#include <string>

#include "anigen/models/dinov2.h"
#include "anigen/prepare/feature_extractor.h"

namespace anigen::features {

/// DINOv2 patch features averaged over the views of an asset (reference training-and-data.md, 1.1): every view is
/// resized to 518², put on black and encoded; each voxel's centre is projected into it and reads the patch tokens
/// before the final norm, bilinearly; views in which it lies outside the picture count as zero.
class DinoFeatures : public prepare::FeatureExtractor {
 public:
  /// @param name a published model (models::Dinov2Options::names) @param weights .pth, .pt or .safetensors
  /// @param device "cpu", "cuda" or "cuda:N" @throws InputError as load_dinov2_weights, or for a device that is not
  /// there
  DinoFeatures(const std::string& name, const std::filesystem::path& weights, const std::string& device = "cpu");
  /// A model of any size under a name of one's own: tests and ablations.
  /// @param image_size pixels to which views are resized, a multiple of the patch size
  DinoFeatures(std::string name, std::string fingerprint, models::Dinov2 model, int image_size);

  std::string name() const override { return name_; }
  /// Names the weights by their SHA-256.
  std::string fingerprint() const override { return fingerprint_; }
  int channels() const override { return static_cast<int>(model_->options().embed_dim); }
  bool needs_views() const override { return true; }
  /// Memory: the model, three arrays of fp32 [N, C], and the batches' attention scores (256 MiB on a CPU, 2 GiB else).
  /// @throws InputError naming the view that is missing or damaged, or as read_transforms
  io::NdArray extract(const prepare::FeatureRequest& request) const override;

 private:
  torch::Tensor encode(const torch::Tensor& images) const;  // [V, 3, S, S] in [0, 1] → [V, P, C]

  std::string name_, fingerprint_;
  mutable models::Dinov2 model_ = nullptr;  // forward() of a torch module is never const
  int image_size_;
};

}  // namespace anigen::features
