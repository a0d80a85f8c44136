#pragma once
/// Says whether a surface is sound and makes it so. check_mesh() counts defects, repair() mends them in place, wrap()
/// encloses whatever there is in a closed surface, remesh() evens out triangles; carry.h moves skin weights, colours
/// and materials to the result. Built with CGAL alone (CMake option ANIGEN_WITH_CGAL): programs that link this folder
/// are GPL-3 as binaries, so only anigen-mesh does. docs/mesh-health.md explains every figure.
#include "anigen/mesh_health/carry.h"
#include "anigen/mesh_health/check.h"
#include "anigen/mesh_health/limited.h"
#include "anigen/mesh_health/remesh.h"
#include "anigen/mesh_health/repair.h"
#include "anigen/mesh_health/weld.h"
#include "anigen/mesh_health/wrap.h"
