#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/loaders/metadata.h"

namespace anigen::loaders {

/// What `skeleton/<id>/skeleton_voxelized.npz` holds, in memory: reference training-and-data.md, section 1.1. World
/// frame, object in [-0.5, 0.5]³. Skin weights are sparse: dense ones of a large set would not fit into memory.
struct RiggedItem {
  std::string id;
  std::vector<Eigen::Vector3f> joints;    ///< [J]
  std::vector<int> parents;               ///< [J], -1 for a root; no cycles, otherwise in any order
  std::vector<Eigen::Vector3f> vertices;  ///< [V]
  std::vector<Triangle> faces;            ///< [F], F > 0
  SkinWeights skin;                       ///< [V] rows; an all-zero row has weight 1 on joint 0
  std::size_t unweighted = 0;             ///< those rows

  std::size_t bytes() const;  ///< memory it takes, about
};

/// Reads one asset. @throws InputError naming file, array and index: missing arrays, wrong shapes, numbers that are
/// not finite, negative weights, parents or faces out of range, cycles, more than max_joints joints
RiggedItem read_rigged_item(const AssetId& asset, std::size_t max_joints = 4096);

/// Joints so that parents come before children, ties by index. @throws InputError on a parent out of range or a
/// cycle @param file only for messages
std::vector<int> parents_first_order(const std::vector<int>& parents, const std::string& file);

}  // namespace anigen::loaders
