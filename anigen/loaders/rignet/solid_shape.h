#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/loaders/rignet/rignet_mesh.h"
#include "anigen/nn/torch.h"
#include "anigen/rig/binding/solid_voxels.h"

namespace anigen::loaders {

/// What is inside a mesh, by solid voxels of 1/88 of its longest side (reference anymate-baselines.md, 9.3), walls
/// included; the mesh need not be closed (rig/binding/solid_voxels.h). Questions are asked in RigNet's frame.
class SolidShape {
 public:
  /// @param vertices, faces Z up, the whole mesh @throws InputError without an extent
  SolidShape(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);

  bool holds(const Eigen::Vector3d& point) const;
  /// @param points [N, 3] @return [N] bool on the CPU
  torch::Tensor holds(const torch::Tensor& points) const;

  /// The way from one point to another, looked at every 0.01, both ends included.
  struct Way {
    double inside = 0.0;  ///< share of the places
    int outside = 0;      ///< their number
  };
  Way way(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const;

  /// The same between all of some joints. @return [J, J] fp32 each, symmetric, their diagonals those of a point
  struct Ways {
    torch::Tensor inside, outside;
  };
  Ways ways(const std::vector<Eigen::Vector3d>& joints) const;

 private:
  RignetFrame frame_;
  Eigen::Vector3d center_ = Eigen::Vector3d::Zero();  ///< of the welded surface's unit frame
  double size_ = 1.0;
  rig::VoxelBlock block_;
  std::vector<bool> is_solid_;  ///< [cells of the block]
};

}  // namespace anigen::loaders
