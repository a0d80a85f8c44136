#pragma once
#include "anigen/lint/finding.h"
#include "anigen/lint/welded_rig.h"

namespace anigen::lint {

/// Joints that move nothing: "dead-joints" are two or more below each other without any weight, except controls,
/// targets and ends, told by their names. Rigs of artists have single joints without weights at every tip.
void check_dead_joints(const WeldedRig& rig, RigLint& lint);

/// Joints with weights against the mesh: "joints-outside" far from its box, "joints-off-body" where most are not
/// enclosed by the surface (of 14 rays from the joint fewer than half hit it).
void check_joint_places(const WeldedRig& rig, RigLint& lint);

/// Bind matrices: "mirrored-bind", "uneven-bind-scale", "scaled-bind", "tilted-root".
void check_bind_matrices(const WeldedRig& rig, RigLint& lint);

}  // namespace anigen::lint
