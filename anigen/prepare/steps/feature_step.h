#pragma once
#include <memory>

#include "anigen/prepare/feature_extractor.h"
#include "anigen/prepare/steps/step.h"

namespace anigen::prepare {

/// features/<model>/<id>.npz: indices u8 [N, 3] and patchtokens f16 [N, C], rows in the order of voxels/<id>.ply.
class FeatureStep : public Step {
 public:
  FeatureStep(std::shared_ptr<const FeatureExtractor> extractor, int resolution);

  /// "features/<model>", so that one dataset can hold the features of several models.
  std::string name() const override { return "features/" + extractor_->name(); }
  int version() const override { return 1; }
  std::vector<std::string> inputs() const override;
  Json options() const override;
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  /// @return channels @throws InputError when a coordinate exceeds 255 or an extractor gives another shape
  Json run(AssetJob& job) const override;

 private:
  std::shared_ptr<const FeatureExtractor> extractor_;
  int resolution_;
};

}  // namespace anigen::prepare
