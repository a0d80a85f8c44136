#pragma once
/// Differentiable rasterization: visibility, interpolation, antialiasing, the mesh renderer of stage 3.
#include "anigen/raster/antialias.h"
#include "anigen/raster/interpolate.h"
#include "anigen/raster/mesh_renderer.h"
#include "anigen/raster/rasterize.h"
