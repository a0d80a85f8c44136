#include "anigen/prepare/steps/voxel_step.h"

#include "anigen/geometry/voxelize.h"
#include "anigen/prepare/voxels/voxel_file.h"

namespace anigen::prepare {

std::vector<std::filesystem::path> VoxelStep::outputs(const AssetPlaces& places, const Json&) const {
  return {places.surface_voxels(), places.skeleton_voxels()};
}

Json VoxelStep::run(AssetJob& job) const {
  const Asset& asset = job.asset();
  const auto surface = geometry::voxelize_surface(asset.mesh.vertices, asset.mesh.faces, resolution_);
  const auto skeleton = geometry::voxelize_bones(asset.skeleton.positions(), asset.skeleton.parents, resolution_);
  write_voxel_ply(job.places().surface_voxels(), surface, resolution_);
  write_voxel_ply(job.places().skeleton_voxels(), skeleton, resolution_);
  job.forget_voxels();
  return {{"num_voxels", surface.size()}, {"num_skeleton_voxels", skeleton.size()}};
}

}  // namespace anigen::prepare
