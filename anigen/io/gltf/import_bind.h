#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/io/gltf/import_document.h"
#include "anigen/io/gltf/import_notes.h"
#include "anigen/io/gltf/import_rig.h"

namespace anigen::io::gltf_import {

/// How the vertices of one skin get into the common bind pose.
struct SkinBinding {
  std::vector<int> joints;  ///< joint of the rig per entry of the skin; empty when the skin is not used
  Eigen::Matrix4d to_bind = Eigen::Matrix4d::Identity();  ///< A: the skin's mesh space → world, Z up
  /// Per entry C_j · IBM_j − A, where C is the common bind pose; empty when all are zero. Not zero when skins
  /// disagree about the bind pose of joints they share: a vertex then goes to Σ w (A + deviation_j) v.
  std::vector<Eigen::Matrix4d> deviation;
};

/// Chooses the world bind matrix C_j of every joint (written to rig.skeleton.bind) from the inverse bind matrices.
/// glTF fixes a bind pose only up to one matrix A per skin: C_j = A · IBM_j⁻¹. A puts the skin's top-most joint where
/// it rests; later skins take it from a joint that an earlier skin has placed. Joints without a usable inverse bind
/// matrix follow their parent as in the rest pose.
/// @throws InputError when no inverse bind matrix of a skin can be used
std::vector<SkinBinding> bind_skins(const Document& document, Rig& rig, Notes& notes);

}  // namespace anigen::io::gltf_import
