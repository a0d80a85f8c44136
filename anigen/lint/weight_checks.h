#pragma once
#include "anigen/asset/rigged_asset.h"
#include "anigen/lint/finding.h"
#include "anigen/lint/welded_rig.h"

namespace anigen::lint {

/// True when the rows of a skin can be read: offsets ascend and stay within the influences. Rows may still be wrong.
bool rows_are_readable(const SkinWeights& skin);

/// Rows as they are: "unweighted-vertices", "bad-weights" (negative, not a number, of a joint that does not exist),
/// "weight-sums", "many-influences". @pre rows_are_readable(asset.skin), one row per vertex
void check_rows(const Asset& asset, RigLint& lint);

/// Weights over the surface. "weight-islands": the vertices that a joint moves by more than 0.05 fall into pieces of
/// one shell, and a small piece lies far from the joint and from the largest piece. "shell-bleed": a joint whose
/// weights lie on other shells moves a vertex that is far from it and near another joint. Figures alone: share of the
/// shells (mesh_shells()) with 99 % of their weight in one joint, `rigid_shell_share`, `rigid_area_share`.
void check_surface_weights(const WeldedRig& rig, RigLint& lint);

}  // namespace anigen::lint
