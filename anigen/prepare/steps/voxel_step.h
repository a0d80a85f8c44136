#pragma once
#include "anigen/prepare/steps/step.h"

namespace anigen::prepare {

/// voxels/<id>.ply and voxels/<id>_skeleton.ply: the voxels that the surface touches and those that the bones cross.
class VoxelStep : public Step {
 public:
  explicit VoxelStep(int resolution) : resolution_(resolution) {}

  std::string name() const override { return "voxels"; }
  int version() const override { return 1; }
  Json options() const override { return {{"resolution", resolution_}}; }
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  /// @return num_voxels, num_skeleton_voxels
  Json run(AssetJob& job) const override;

 private:
  int resolution_;
};

}  // namespace anigen::prepare
