#pragma once
#include "anigen/shape_field/flexicubes.h"

namespace anigen::shape_field {

struct DualVertices {
  Tensor values;     ///< [D, channels]
  Tensor deviation;  ///< [K] |d − mean d| with d the distance to the crossing of each edge; undefined unless asked for
};

/// Dual vertices: per group of edges the mean of its crossings weighted with beta, where alpha weighs the signed
/// distances at the corners (docs/reference/autoencoders.md, 5.2). Differentiable once in rows, alpha and beta. On the
/// CPU every cube is worked on by itself, without the lists of edges that tensor operations would need.
/// @param rows [S, 1 + channels] at the grid vertices of the topology: sdf, position, attributes; fp32 or fp64
/// @param alpha [Q, 8] @param beta [Q, 12] activated
DualVertices dual_vertices(const Tensor& rows, const Tensor& alpha, const Tensor& beta, const DualTopology& topology,
                           bool with_deviation);

/// As above, by tensor operations on lists of all crossing edges: the formula as one would write it down. What other
/// devices use, and what the kernels are tested against.
DualVertices tensor_dual_vertices(const Tensor& rows, const Tensor& alpha, const Tensor& beta,
                                  const DualTopology& topology, bool with_deviation);

}  // namespace anigen::shape_field
