#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/io/rigs/dataset_list.h"

namespace anigen::eval {

/// Keeps the items that split files name, one a line, by any of their names (io::NameIndex); blank lines and lines
/// starting with '#' are skipped. @throws InputError naming the line for a name that no item has, or several
std::vector<io::DatasetItem> select_split(const std::vector<io::DatasetItem>& items,
                                          const std::vector<std::filesystem::path>& splits);

/// skeleton/<id>/skeleton_voxelized.npz, checked: shapes agree, numbers are finite, indices in range.
struct GroundTruth {
  std::vector<Eigen::Vector3f> joints;    ///< [J], normalised frame, Z up
  std::vector<int> parents;               ///< [J], -1 for the root
  std::vector<float> skin;                ///< [V, J] row-major; zero rows became weight 1 on joint 0, rows sum to 1
  std::size_t unweighted = 0;             ///< those zero rows
                                          ///< (reference autoencoders.md, 1.3)
  std::vector<Eigen::Vector3f> vertices;  ///< [V]
  std::vector<Triangle> faces;

  std::size_t joint_count() const { return joints.size(); }
  std::size_t vertex_count() const { return vertices.size(); }
};

/// @throws InputError naming file and array: a part missing or of another shape, a number that is not finite, an index
/// out of range, no joint, a cycle, no vertex
GroundTruth read_ground_truth(const std::filesystem::path& root, const std::string& id);

/// An asset to draw: the mesh and skeleton of the ground truth with these weights. @param skin [V, J]
Asset to_asset(const GroundTruth& truth, const std::vector<float>& skin);

}  // namespace anigen::eval
