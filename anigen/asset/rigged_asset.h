#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/asset/animation.h"
#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"

namespace anigen {

/// An animatable asset: mesh, skeleton, skin weights, and what the file brought along. The mesh is in its bind
/// pose. World frame: right-handed, Z up; the unit is the file's until normalize() was called.
struct Asset {
  std::string name;
  Mesh mesh;
  Skeleton skeleton;
  SkinWeights skin;
  std::vector<Material> materials;
  std::vector<EncodedImage> images;
  std::vector<Animation> animations;
};

/// Gives an asset without a rig one joint at the origin, which every vertex follows: what io::write_gltf can write.
void bind_rigidly(Asset& asset, const std::string& joint);

/// Everything wrong with an asset, one sentence each, naming the array and index; empty when it is sound. Checks
/// array lengths, index ranges, finiteness, the tree (one root first, parents before children, unique names),
/// invertible bind matrices, weight rows (sum, order, repeated joints), animations (times increase, sizes) and
/// image references. Never throws and never reads out of range, whatever it is given.
/// @param at_most stop after this many findings of one kind; the last one says how many more there were
/// @param require_rig false: parts may be missing, as long as there is a mesh or a skeleton: a mesh without skeleton
/// and weights is sound, too, a skeleton without mesh, the two without weights, and points without faces
std::vector<std::string> validate(const Asset& asset, std::size_t at_most = 3, bool require_rig = true);

/// x → scale · x + offset.
struct Similarity {
  double scale = 1.0;
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
};

/// Applies the similarity to mesh, bind pose, rest pose and animations alike. Joint orientations and joint scales
/// stay as they are: translations carry the change.
void apply(const Similarity& similarity, Asset& asset);

/// Puts the mesh's bounding box into [-0.5, 0.5]³: centre at the origin, longest side 1 (docs/reference/training.md,
/// 1.1). @return what was applied
/// @throws InputError when the box is empty, not finite, or has no extent
Similarity normalize(Asset& asset);

/// Linear blend skinning: Σ_j w_vj · world_j · bind_j⁻¹ · v for every vertex, [V].
/// @param world joint → world of the pose, [J], from forward_kinematics
std::vector<Eigen::Vector3f> skin_vertices(const Asset& asset, const std::vector<Eigen::Matrix4d>& world);

/// The asset's mesh in a pose.
std::vector<Eigen::Vector3f> skin_vertices(const Asset& asset, const Pose& pose);

}  // namespace anigen
