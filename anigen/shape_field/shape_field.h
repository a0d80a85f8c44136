#pragma once
/// The shape field (paper 3.2): averaged cubes, FlexiCubes, the mesh it gives and the losses on it. flexicubes.h is
/// the published algorithm; dual_vertices.h its dual vertices.
#include "anigen/shape_field/cube_field.h"
#include "anigen/shape_field/dual_vertices.h"
#include "anigen/shape_field/flexicubes.h"
#include "anigen/shape_field/grid.h"
#include "anigen/shape_field/mesh_extraction.h"
#include "anigen/shape_field/row_links.h"
