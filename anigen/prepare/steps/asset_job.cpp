#include "anigen/prepare/steps/asset_job.h"

#include <utility>

#include "anigen/prepare/voxels/voxel_file.h"

namespace anigen::prepare {

AssetJob::AssetJob(AssetPlaces places, std::function<Asset()> load)
    : places_(std::move(places)), load_(std::move(load)) {}

const Asset& AssetJob::asset() {
  if (!asset_) asset_ = load_();
  return *asset_;
}

const std::vector<geometry::Voxel>& AssetJob::surface_voxels(int resolution) {
  if (!voxels_) voxels_ = read_voxel_ply(places_.surface_voxels(), resolution);
  return *voxels_;
}

}  // namespace anigen::prepare
