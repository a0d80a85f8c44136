#pragma once
/// Geometry of meshes, points and voxels without learning. Nearest points and surfaces, distances to bones, sampling,
/// simplification, hole filling, voxels, transfer of skin weights, texture atlases (uv_atlas/).
#include "anigen/geometry/bones.h"
#include "anigen/geometry/correspondence.h"
#include "anigen/geometry/crossings.h"
#include "anigen/geometry/fill_holes.h"
#include "anigen/geometry/hidden_faces.h"
#include "anigen/geometry/inside.h"
#include "anigen/geometry/nearest_point.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/primitives.h"
#include "anigen/geometry/ray_caster.h"
#include "anigen/geometry/sampling.h"
#include "anigen/geometry/simplify.h"
#include "anigen/geometry/voxel_grid.h"
#include "anigen/geometry/voxelize.h"
