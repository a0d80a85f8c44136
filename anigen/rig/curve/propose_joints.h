#pragma once
#include <cstddef>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"

namespace anigen::rig {

/// Lengths are in shares of the longest side of the mesh's box, radii in those of the shape around the curve.
struct CurveSkeletonOptions {
  int resolution = 96;                 ///< cells of the solid along the longest side, 8 to 512
  std::size_t target_vertices = 3000;  ///< of the surface that is contracted, all pieces together, 100 to 100,000
  std::size_t most_pieces = 32;        ///< the largest that count, 1 or more
  double least_piece = 0.001;          ///< share of the volume below which a piece does not count

  double spur_radii = 1.0;       ///< branches shorter than this many radii of where they leave are left out,
  double spur_length = 0.04;     ///<   and those shorter than this
  double join_radii = 0.75;      ///< branching points nearer than this many radii are one
  double bend = 0.015;           ///< how far a curve may be off its bones
  double longest_bone = 0.25;    ///< longer ones are cut into equal parts
  std::size_t most_joints = 60;  ///< 2 or more
};

/// A skeleton along the middle of a mesh, whatever it shows: its surface is contracted to a curve by mean curvature
/// flow (curve_skeleton/contract_curve.h), joints go to the branches, ends and bends of the curve (curve_joints.h).
///
/// The mesh need not be closed. What is contracted is the boundary of the solid that it suggests (solid_field.h) on a
/// regular grid: parts that overlap or come within a cell of each other are one piece; sheets get a thickness. Each
/// piece is contracted by itself; pieces too small to count and walls of cavities are left out, and the curves are
/// connected where they are nearest to each other. Of a handle the thinnest place is cut; a tangle with more than 50
/// handles is looked at with half as many cells, and half again, until it has fewer. Where there would be more
/// than most_joints, what counts as spur, bend and long is enlarged until there are not. Bounded by the grid and the
/// number of vertices; deterministic.
/// @return the mesh's frame and unit; at least 2 joints
/// @throws NotSupportedError in a build without CGAL (CMake option ANIGEN_WITH_CGAL)
/// @throws InputError as solid_field(), or for options out of range
Skeleton propose_curve_skeleton(const Mesh& mesh, const CurveSkeletonOptions& options = {});

}  // namespace anigen::rig
