#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

/// One row of an evaluation: a truth and, when there is one, its prediction.
struct PairPlan {
  std::string id;                            ///< what the row is called
  std::string truth_id;                      ///< in the truth's source
  std::optional<std::string> prediction_id;  ///< in the prediction's source
  std::string missing_reason;                ///< why there is no prediction; empty when there is
};

struct PairList {
  std::vector<PairPlan> pairs;      ///< one per truth asked for, in that order
  std::vector<std::string> unused;  ///< predictions that belong to none of them
};

/// True when a name ends in the sha256 of a content.
bool ends_in_sha256(const std::string& id);

/// Finds each truth's prediction: the one of equal id; else the one that io::NameIndex finds by any name of the truth
/// (uuid, sha256, path, "<shard>#<uuid>"), by the sha256 of the truth's content, or by the folder that the prediction
/// lies in. Two single files are a pair whatever their names.
/// @param truth_ids ids of `truth`, each once (select_ids)
/// @throws InputError naming the candidates when two predictions could be meant for one truth, or two truths by one
/// prediction
PairList match_pairs(const io::ShapeSource& truth, const io::ShapeSource& prediction,
                     const std::vector<std::string>& truth_ids);

/// Keeps the items that split files name, one a line, by any of their names (io::NameIndex); blank lines and lines
/// starting with '#' are skipped. @throws InputError naming the line for a name that no item has, or several
std::vector<io::DatasetItem> select_split(const std::vector<io::DatasetItem>& items,
                                          const std::vector<std::filesystem::path>& splits);

/// skeleton/<id>/skeleton_voxelized.npz, checked: shapes agree, numbers are finite, indices in range.
struct GroundTruth {
  std::vector<Eigen::Vector3f> joints;    ///< [J], normalised frame, Z up
  std::vector<int> parents;               ///< [J], -1 for the root
  std::vector<float> skin;                ///< [V, J] row-major; zero rows became weight 1 on joint 0, rows sum to 1
  std::size_t unweighted = 0;             ///< those zero rows (docs/reference/autoencoders.md, 2.3)
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
