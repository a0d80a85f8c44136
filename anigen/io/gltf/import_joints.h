#pragma once
#include <cstddef>
#include <vector>

#include "anigen/io/gltf/import_document.h"
#include "anigen/io/gltf/import_notes.h"

namespace anigen::io::gltf_import {

/// Which nodes of the file become joints.
struct JointChoice {
  std::vector<char> is_joint;   ///< per node
  std::vector<char> skin_used;  ///< per skin: shown in the scene, or all of its joints are
};

/// The joints of every used skin, and promoted: nodes above joints that move or that cannot be folded into a joint
/// (uneven scale, shear), and moving nodes that carry meshes without skin.
/// @param moving per node, from moving_nodes()
/// @param require_skin false: a scene without a skin has no joints where it shows triangles; where it does not, they
/// are the nodes that move and all below them
/// @throws InputError when there is no skin and one is required
JointChoice choose_joints(const Document& document, const std::vector<char>& moving, bool require_skin, Notes& notes);

/// Per node, the number of marked nodes at or below it.
std::vector<int> count_below(const Document& document, const std::vector<char>& marked);

/// The deepest node that has all of these at or below it, or -1. @pre none of them is above another
int common_ancestor(const Document& document, const std::vector<int>& nodes);

}  // namespace anigen::io::gltf_import
