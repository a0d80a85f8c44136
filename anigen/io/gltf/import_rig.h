#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/io/gltf/import_document.h"
#include "anigen/io/gltf/import_notes.h"
#include "anigen/io/gltf/import_similarity.h"

namespace anigen::io::gltf_import {

/// The one skeleton that all skins of a file are merged into, and where the file's nodes went.
struct Rig {
  Skeleton skeleton;                         ///< Z up through the root; `bind` is filled by bind_skins()
  std::vector<int> node_of_joint;            ///< [J]; -1 for a root that was made
  std::vector<FoldedTransform> prefix;       ///< [J] what the folded nodes above a joint, and the axes at the root, put
                                             ///< before the joint's own T · R · S
  std::vector<int> joint_of_node;            ///< [N] or -1
  std::vector<int> nearest_joint;            ///< [N] the joint at or above a node, or -1
  std::vector<Eigen::Matrix4d> below_joint;  ///< [N] node → space of that joint; → glTF's world when there is none
  std::vector<char> skin_used;               ///< per skin of the file
};

/// Chooses the joints (those of every skin in the scene; nodes above them that move or that scale unevenly; moving
/// nodes that carry rigid meshes), folds static nodes between them, and puts one root on top.
/// A scene without a skin may leave a rig without joints, as options.require_rig says.
/// @param moving per node, from moving_nodes()
/// @throws InputError when there is no skin and options.require_rig, or there are too many joints
Rig build_rig(const Document& document, const std::vector<char>& moving, const ImportOptions& options, Notes& notes);

}  // namespace anigen::io::gltf_import
