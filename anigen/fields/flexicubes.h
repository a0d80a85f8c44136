#pragma once
#include "anigen/fields/cube_field.h"

namespace anigen::fields {

struct ExtractedSurface {
  Tensor vertices;    ///< [V, 3] object space; empty [0, 3] without a sign change
  Tensor faces;       ///< [F, 3] int64, counter-clockwise seen from outside (positive sdf)
  Tensor attributes;  ///< [V, A]
  Tensor deviation;   ///< [K] L_dev, one value per (dual vertex, crossing edge); only filled when training
};

/// Dual surface of the zero level set with FlexiCubes' weights (Shen et al. 2023; reference autoencoders.md, 4.3):
/// vertices, faces and attributes in the published order, on the field's device. Differentiable once in the field, away
/// from sign changes. Inside is sdf < 0; where the surface reaches the boundary of the grid it stays open. Two sheets
/// that pass an ambiguous cube may meet in an edge of more than two faces, as with every dual method. Edges whose first
/// end has sdf exactly 0 are wound as published, that is, facing inside. Memory follows the cubes at the surface.
/// @param training quads become four triangles around a centre vertex, and the deviation is computed; otherwise two
/// along the diagonal that gamma chooses
ExtractedSurface flexicubes(const CubeField& field, bool training);

}  // namespace anigen::fields
