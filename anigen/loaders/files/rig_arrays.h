#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/io/ndarray.h"
#include "anigen/loaders/metadata.h"

namespace anigen::loaders {

/// `skeleton/<id>/skeleton_voxelized.npz` as stored (reference training-and-data.md, section 1.1): world frame, object
/// in [-0.5, 0.5]³.
struct RigArrays {
  std::vector<Eigen::Vector3f> joints;     ///< [J], J ≥ 1
  std::vector<int> parents;                ///< [J], -1 for a root; no cycles, otherwise in any order
  std::vector<Eigen::Vector3f> vertices;   ///< [V]
  std::vector<Triangle> faces;             ///< [F], F > 0
  io::Dtype face_dtype = io::Dtype::kI64;  ///< of `faces` in the file
  std::vector<float> skin;                 ///< [V, J] row-major, finite, ≥ 0; rows need not sum to 1
};

/// @throws InputError naming file, array and index: missing arrays, wrong shapes, numbers that are not finite, negative
/// weights, parents or faces out of range, cycles, more than max_joints joints, sizes beyond reason
RigArrays read_rig_arrays(const AssetId& asset, std::size_t max_joints = 4096);

/// The file read_rig_arrays reads.
std::filesystem::path rig_path(const AssetId& asset);

}  // namespace anigen::loaders
