#pragma once
#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/io/rigs/joint_tree.h"

namespace anigen::io {

/// The clips of a file with the skeleton that they move, joint axes and all.
struct RigClips {
  Skeleton skeleton;
  std::vector<Animation> animations;  ///< at least one
};

/// What one file says about one object: any part may be missing, and each user says which ones it needs. Unlike Asset
/// it is not repaired: a forest stays one.
struct RiggedShape {
  std::string id;    ///< what predictions and ground truth are matched by
  std::string file;  ///< where it came from, for messages
  Mesh mesh;         ///< Z up, the file's unit; no faces: a point set
  std::vector<Material> materials;
  std::vector<EncodedImage> images;
  JointTree joints;                      ///< checked; empty only when the file has no skeleton
  std::vector<std::string> joint_names;  ///< [J] or empty
  SkinWeights skin;                      ///< one row per vertex, or no rows when the file has no weights
  /// What moves the joints, which keep the skeleton's order; null without a clip. It stays as the file's format has it
  /// when the shape is turned or moved: `clips_turn` leads from there to the frame that the shape was read into.
  std::shared_ptr<const RigClips> clips;
  Eigen::Matrix3d clips_turn = Eigen::Matrix3d::Identity();
  std::size_t unweighted = 0;      ///< vertices without weights in the file, bound to the root
  double lowest_weight_sum = 1.0;  ///< of a vertex with weights in the file
  std::vector<std::string> notes;  ///< what was repaired or left out while reading

  bool has_surface() const { return !mesh.faces.empty(); }
  bool has_joints() const { return joints.size() > 0; }
  bool has_skin() const { return skin.rows() > 0 && skin.rows() == mesh.vertices.size() && has_joints(); }
};

/// The asset's bind pose, and its clips.
RiggedShape rigged_shape(Asset asset, const std::string& id, const std::string& file);

/// Roots joined, parents moved before children, skin renumbered with them; joints keep their names as far as these are
/// unique. @throws InputError when there is no joint
Asset to_asset(const RiggedShape& shape);

}  // namespace anigen::io
