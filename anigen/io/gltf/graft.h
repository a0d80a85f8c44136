#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::io {

struct GraftOptions {
  std::size_t influences = 4;  ///< per vertex, at least 1; more than 4 writes JOINTS_1/WEIGHTS_1 and so on
  bool replace = false;        ///< the skeleton is a new one even where it has the joints of the file's own
  /// Names to write for the joints, [J]; empty: those of the skeleton, by which a file's own are known.
  std::vector<std::string> names = {};
  /// Moves the bind pose of the meshes, which the skeleton has been through already: a rotation, one scale and a
  /// translation, Z up. For new skeletons.
  Eigen::Matrix4d placement = Eigen::Matrix4d::Identity();
  RootExtensions extensions = {};  ///< those that the file has already are replaced
};

struct GraftReport {
  bool own_joints = false;        ///< the skeleton had the file's own: its joints and animations stayed
  std::size_t bound_nodes = 0;    ///< nodes whose mesh got weights
  std::size_t copied_meshes = 0;  ///< mesh objects that were added because several nodes show one mesh
  std::vector<ImportNote> notes;
};

/// Writes a copy of a glTF file with a rig in it. Nothing else changes: materials, textures, tangents, UV sets, morph
/// targets, compressed data, extensions and extras stay as they are, and so do the digits of every number. The bytes of
/// the first buffer are the beginning of the copy's first buffer; further buffer files become data URIs, image files
/// views of the first buffer, so that the copy needs no file beside it (files that extensions name stay where they
/// are).
///
/// A new skeleton becomes nodes in its rest pose, its root in every scene that shows a bound mesh, and one skin per
/// placement of meshes. A skinned mesh ignores the transform of its node (glTF 2.0, section 3.7.3.3), which therefore
/// goes into the inverse bind matrices: bind⁻¹ · (mesh → bind pose). JOINTS_n and WEIGHTS_n replace those the
/// primitives had; skins that no node has any more go. A mesh that several nodes show gets a copy of its JSON for each
/// further one, with the accessors of the first. Where one animation of a file without a rig carries all meshes, it
/// carries the root of the skeleton instead. Points and lines beside triangles follow the nearest vertex of these.
///
/// A skeleton with the names, parents and places of the file's own is taken for the file's own: nodes, skins and
/// animations stay and only the weights are new. Joints that such a skeleton has beside them become further nodes below
/// their parents'. A skin gets more joints where weights ask for joints beyond its own; a
/// mesh without skin that follows a joint stays as it is when that is what its weights say.
///
/// Nodes without triangles, of other scenes, or whose transform collapses the mesh stay as they are.
/// @param original .glb or .gltf @param skeleton, skin in the frame of read_gltf() (Z up) with
/// ImportOptions::require_rig = false, one row per vertex of its mesh
/// @param out .glb, or .gltf with everything inside; written atomically
/// @throws InputError when the file cannot be read, the rig is not sound or does not fit it; NotSupportedError naming
/// the node when animations move meshes apart in a file without a rig, skins disagree about the bind pose, a node is
/// instanced by EXT_mesh_gpu_instancing, the skeleton's root would have to be sheared, or an animation carries what
/// `placement` would move
GraftReport graft_rig(const std::filesystem::path& original, const Skeleton& skeleton, const SkinWeights& skin,
                      const std::filesystem::path& out, const GraftOptions& options = {});

}  // namespace anigen::io
