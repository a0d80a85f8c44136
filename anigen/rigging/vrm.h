#pragma once
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/core/config.h"
#include "anigen/rigging/humanoid.h"

namespace anigen::rigging {

/// Title, authors and permissions of a VRM file. Permissions are those that VRM takes where a file says nothing: use by the author
/// alone, no redistribution, no changes.
struct VrmMeta {
  std::string name;                  ///< of the model; empty: "model"
  std::vector<std::string> authors;  ///< none: "unknown"
  std::string copyright;             ///< may be empty
};

/// Joints that swing behind the body: hair, tails, ears, skirts.
struct Spring {
  std::string name;         ///< of its first joint
  std::vector<int> joints;  ///< each the parent of the next; the last is the end of the one before
  double radius = 0.0;      ///< metres, of the surface around it
  double stiffness = 1.0;
};

/// Chains of two joints or more with weights that begin at a bone of trunk, head, upper arm or leg and lead to no bone.
/// Not those of fingers, faces, things that are held, and helpers.
/// @param mesh in its bind pose @param skin one row per vertex; empty: no springs
std::vector<Spring> find_springs(const Skeleton& skeleton, const Humanoid& humanoid, const Mesh& mesh,
                                 const SkinWeights& skin);

/// The extensions VRMC_vrm (meta, humanoid) and, where there are springs, VRMC_springBone, both 1.0.
/// @param node_of_joint nodes of the file @pre the humanoid has all required bones
Json vrm_extensions(const Skeleton& skeleton, const Humanoid& humanoid, const std::vector<Spring>& springs,
                    const VrmMeta& meta, const std::vector<int>& node_of_joint);

/// Largest angle in degrees between an upper arm and the horizontal. VRM wants a T-pose, in which it is 0.
double degrees_from_t_pose(const Skeleton& skeleton, const Humanoid& humanoid);

}  // namespace anigen::rigging
