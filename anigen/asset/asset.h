#pragma once
/// The rigged asset in memory: mesh, skeleton, skin weights, animation. World frame: right-handed, Z up, longest side
/// 1 inside [-0.5, 0.5]^3. Joints stand parents before children, joint 0 is the only root; skin weights are sparse
/// rows that sum to 1.
#include "anigen/asset/animation.h"
#include "anigen/asset/joint_side.h"
#include "anigen/asset/mesh.h"
#include "anigen/asset/mesh_shells.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/rigid_parts.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
