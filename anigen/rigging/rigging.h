#pragma once
/// Riggers that learn nothing: Pinocchio embedding, curve joints, templates; weights by bone heat, geodesic voxels or
/// nearest bone, and features of them for a network that corrects them. rig_meshes.h runs a method over many meshes.
#include "anigen/rigging/binding.h"
#include "anigen/rigging/bone_heat.h"
#include "anigen/rigging/curve.h"
#include "anigen/rigging/pinocchio.h"
#include "anigen/rigging/pinocchio_discrete.h"
#include "anigen/rigging/pinocchio_solid.h"
#include "anigen/rigging/pinocchio_spheres.h"
#include "anigen/rigging/pinocchio_template.h"
#include "anigen/rigging/rig_meshes.h"
#include "anigen/rigging/skin_features.h"
#include "anigen/rigging/surface.h"
#include "anigen/rigging/voxels.h"
