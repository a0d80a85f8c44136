#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/skin_weights.h"
#include "anigen/core/config_fields.h"
#include "anigen/core/random.h"

namespace anigen::data {

/// Changes a training sample of the skin auto-encoder goes through, so that few rigs teach as much as many. Ours;
/// the published trainer has none, and everything is off by default. All but the last two leave the true weights
/// of a valid rig: they are functions of the skeleton, or of skeleton and weights together.
struct Augmentations {
  enum class Rotation { kNone, kAboutZ, kAny };
  Rotation rotation = Rotation::kNone;
  double anisotropic_scale = 0.0;  ///< each axis by exp(u), u uniform in ± this
  double random_pose = 0.0;        ///< joints turn by normal angles of this many degrees; positions only
  double joint_jitter = 0.0;       ///< normal offsets of this many lengths of the joint's bone
  double merge_joints = 0.0;       ///< up to this share of the joints goes into their parents, weights added
  double drop_leaves = 0.0;        ///< probability of dropping all leaves without weight
  double blend_sampling = 0.0;     ///< share of the points drawn where several joints share the skin
  double sharpen = 0.0;            ///< weights to the power exp(u), u uniform in ± this, one per sample

  void fields(ConfigFields& f);  ///< `augmentations` of the trainer
};

/// A skeleton on its way through the augmentations, and where its weights come from.
struct RigDraw {
  std::vector<Eigen::Vector3f> joints;
  std::vector<int> parents;   ///< -1 for a root
  std::vector<int> joint_of;  ///< [joints of the asset] → joint here that carries its weight
};

RigDraw unchanged(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents);

/// Uniform rotation about z, or of all of SO(3) (Shoemake 1992), about the origin.
void rotate(RigDraw& rig, Augmentations::Rotation rotation, Rng& rng);
void scale_axes(RigDraw& rig, double range, Rng& rng);
/// Every joint turns everything below it about itself by a normal angle about a uniform axis.
/// @param order parents before children
void pose(RigDraw& rig, const std::vector<int>& order, double degrees, Rng& rng);
/// The bone of a joint is the way to its parent; a root's the mean way to its children; a lone joint stays.
void jitter_joints(RigDraw& rig, double bone_lengths, Rng& rng);
/// Merges k joints, k uniform in 0 … share · (J − roots), each into its parent, whose weight it adds to its own.
void merge_joints(RigDraw& rig, double share, Rng& rng);
/// Drops joints whose whole subtree carries no weight. @param used [joints of the asset] whether any vertex uses it
void drop_unweighted(RigDraw& rig, const std::vector<bool>& used);

/// All of the above that are switched on, in that order. @param used see drop_unweighted
RigDraw augment(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents,
                const std::vector<int>& order, const std::vector<bool>& used, const Augmentations& options, Rng& rng);

/// Row of `count` weights that sum to 1 → each to the power, divided by the new sum.
void sharpen(float* row, std::size_t count, float power);

}  // namespace anigen::data
