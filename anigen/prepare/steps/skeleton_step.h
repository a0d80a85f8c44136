#pragma once
#include "anigen/prepare/steps/step.h"

namespace anigen::prepare {

/// skeleton/<id>/skeleton_voxelized.npz: joints, parents, dense weights and mesh.
class SkeletonStep : public Step {
 public:
  std::string name() const override { return "skeleton"; }
  int version() const override { return 1; }
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  Json run(AssetJob& job) const override;
};

/// assets/<id>.glb: the asset itself, in the dataset's frame, with every influence and animation.
class KeepAssetStep : public Step {
 public:
  std::string name() const override { return "asset"; }
  int version() const override { return 1; }
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  Json run(AssetJob& job) const override;
};

}  // namespace anigen::prepare
