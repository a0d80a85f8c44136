#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/asset.h"

namespace anigen::eval {

/// One line of a dataset's metadata.csv, as far as evaluation needs it.
struct DatasetItem {
  std::string id;      ///< the sha256 column
  std::string name;    ///< something readable: local_path, else file_identifier, else the id
  std::string source;  ///< "real", "procedural:<family>", or empty
  bool usable = true;  ///< not is_bad_skeleton
  bool bad_skin = false;
};

/// The dataset's items in file order. @throws InputError when metadata.csv is missing, malformed, without `sha256`,
/// or repeats an id
std::vector<DatasetItem> list_dataset(const std::filesystem::path& root);

/// Keeps the ids that a split file names, one a line, blank lines and lines starting with '#' skipped.
/// @throws InputError naming the line for an id that the dataset does not have
std::vector<DatasetItem> select_split(const std::vector<DatasetItem>& items,
                                      const std::vector<std::filesystem::path>& splits);

/// skeleton/<id>/skeleton_voxelized.npz, checked: shapes agree, numbers are finite, indices in range.
struct GroundTruth {
  std::vector<Eigen::Vector3f> joints;    ///< [J], normalised frame, Z up
  std::vector<int> parents;               ///< [J], -1 for the root
  std::vector<float> skin;                ///< [V, J] row-major; zero rows became weight 1 on joint 0, rows sum to 1
                                          ///< (reference autoencoders.md, 1.3)
  std::vector<Eigen::Vector3f> vertices;  ///< [V]
  std::vector<Triangle> faces;

  std::size_t joint_count() const { return joints.size(); }
  std::size_t vertex_count() const { return vertices.size(); }
};

GroundTruth read_ground_truth(const std::filesystem::path& root, const std::string& id);

/// An asset to draw: the mesh and skeleton of the ground truth with these weights. @param skin [V, J]
Asset to_asset(const GroundTruth& truth, const std::vector<float>& skin);

}  // namespace anigen::eval
