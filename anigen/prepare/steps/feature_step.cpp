#include "anigen/prepare/steps/feature_step.h"

#include <cstdint>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/npz.h"

namespace anigen::prepare {

FeatureStep::FeatureStep(std::shared_ptr<const FeatureExtractor> extractor, int resolution)
    : extractor_(std::move(extractor)), resolution_(resolution) {
  if (resolution_ > 256) {
    throw InputError("", "--resolution", "features index voxels by bytes: at most 256 with --features");
  }
}

std::vector<std::string> FeatureStep::inputs() const {
  if (extractor_->needs_views()) return {kImport, "voxels", "views"};
  return {kImport, "voxels"};
}

Json FeatureStep::options() const { return {{"model", extractor_->fingerprint()}}; }

std::vector<std::filesystem::path> FeatureStep::outputs(const AssetPlaces& places, const Json&) const {
  return {places.features(extractor_->name())};
}

Json FeatureStep::run(AssetJob& job) const {
  const std::vector<geometry::Voxel>& voxels = job.surface_voxels(resolution_);
  const FeatureRequest request{job.asset(), voxels, resolution_,
                               extractor_->needs_views() ? job.places().views() : std::filesystem::path()};
  io::NdArray features = extractor_->extract(request);
  const auto rows = static_cast<std::int64_t>(voxels.size());
  if (features.dtype != io::Dtype::kF16 || features.shape != std::vector<std::int64_t>{rows, extractor_->channels()}) {
    throw Error("feature extractor " + extractor_->name() + " gave another shape or type than it announces");
  }
  std::vector<std::uint8_t> indices;
  indices.reserve(3 * voxels.size());
  for (const geometry::Voxel& voxel : voxels) {
    for (const std::int32_t coordinate : voxel) indices.push_back(static_cast<std::uint8_t>(coordinate));
  }
  io::write_npz(job.places().features(extractor_->name()),
                {{"indices", io::NdArray::from(indices, {rows, 3})}, {"patchtokens", std::move(features)}});
  return {{"channels", extractor_->channels()}};
}

}  // namespace anigen::prepare
