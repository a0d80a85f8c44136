#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/rigging/pinocchio_solid.h"

namespace anigen::rigging {

/// A closed, oriented two-manifold of one piece.
struct ClosedMesh {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Triangle> faces;  ///< counter-clockwise from outside
  double volume = 0.0;
};

/// The boundary of a solid, by marching tetrahedra (Doi and Koide 1991; six to a cell along its diagonal, which needs
/// no cases and cannot give a surface that is not closed), cut into its pieces, largest volume first. Walls of cavities
/// are left out. The frame is the field's.
std::vector<ClosedMesh> solid_pieces(const SolidField& field);

/// Simplifies a surface to fewer vertices (geometry/simplify.h), still closed. @param target_vertices at least 4
ClosedMesh with_fewer_vertices(const ClosedMesh& mesh, std::size_t target_vertices);

/// A curve with the thickness of what is around it, as a tree of points.
struct CurveTree {
  std::vector<Eigen::Vector3d> points;
  std::vector<double> radii;                 ///< [points]
  std::vector<std::vector<int>> neighbours;  ///< [points], ascending

  std::size_t size() const { return points.size(); }
  std::size_t degree(int p) const { return neighbours[static_cast<std::size_t>(p)].size(); }
};

/// Curves as one tree. Of every cycle the edge around which the shape is thinnest is left out, and pieces are connected
/// where they are nearest to each other. @pre points are finite
CurveTree curve_tree(const std::vector<Eigen::Vector3d>& points, const std::vector<double>& radii,
                     const std::vector<std::array<int, 2>>& edges);

/// Takes out branches that end, the shortest first, while they reach less far than `radii` times the radius where they
/// leave the rest, or than `length`. A curve without branches stays.
CurveTree without_spurs(CurveTree tree, double radii, double length);

/// Makes one point of branching points that are nearer to each other along the curve than `radii` times the larger of
/// their radii: what is one hip has three legs, not two forks one after the other.
CurveTree with_joined_branches(CurveTree tree, double radii);

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
/// flow (curve_skeleton/contraction.h), joints go to the branches, ends and bends of the curve.
///
/// The mesh need not be closed. What is contracted is the boundary of the solid that it suggests (solid_field()) on a
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

}  // namespace anigen::rigging
