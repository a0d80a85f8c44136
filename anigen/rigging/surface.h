#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"

namespace anigen::rigging {

/// A mesh as binding sees it. Vertices at exactly the same position are one place, so that texture seams neither part a
/// surface nor its weights, and everything is sorted, so that results do not depend on the order of vertices and faces.
/// Unit frame: the middle of the box around the faces is the origin, its longest side is 1.
struct WeldedSurface {
  std::vector<Eigen::Vector3d> places;  ///< [P] unit frame, in lexicographic order
  std::vector<std::int32_t> of_vertex;  ///< [V] the place of each vertex
  std::vector<Triangle> faces;          ///< of places; three different ones each, no set of three twice
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double size = 1.0;  ///< longest side; 1 when the faces have no extent, as has_extent says
  bool has_extent = false;

  Eigen::Vector3d to_unit(const Eigen::Vector3d& point) const { return (point - center) / size; }
};

/// @throws InputError naming a vertex that is not finite or a face that refers to a missing one
WeldedSurface weld_surface(const Mesh& mesh);

/// Rows of places as rows of vertices.
SkinWeights rows_of_vertices(const SkinWeights& rows_of_places, const WeldedSurface& surface);

/// Parts of a welded surface that hang together by faces, in the order of their first places; a place without faces is
/// a part of its own.
struct SurfaceParts {
  std::vector<std::int32_t> of_place;  ///< [P]
  std::vector<double> volumes;         ///< signed, about a place of the part: positive when faces wind outward
  std::vector<double> areas;

  std::size_t size() const { return volumes.size(); }
  /// A closed part has at most the volume of a sphere of its area; a sheet has next to none, whatever its winding.
  bool encloses_space(std::size_t part) const;
};

SurfaceParts surface_parts(const WeldedSurface& surface);

/// Area-weighted normals of places [P], unit length, pointing out of the part where the part encloses space and has
/// been wound inward, too; zero where no face gives one.
std::vector<Eigen::Vector3d> outward_normals(const WeldedSurface& surface, const SurfaceParts& parts);

struct BoneLine {
  Eigen::Vector3d start, end;
};

/// Vertices that a joint moves (geometry/bones.h).
struct MovingBones {
  std::vector<BoneLine> lines;  ///< at least one
  bool is_tip = false;          ///< the joint has no children: its line is made up, and may leave the body
};

/// The bones of every joint, [J], in the unit frame of a surface. Joints more than a million of the surface's sizes
/// away count as that far.
/// @throws InputError without joints, or naming one that is not finite or whose parent does not come before it
std::vector<MovingBones> moving_bones(const Skeleton& skeleton, const WeldedSurface& surface);

/// Makes one line of those of every joint with several children: to the middle of their ends. A root's lines to all its
/// children run through the whole body, and are nearest to most of it.
void join_lines(std::vector<MovingBones>& bones);

/// Distance from a point to the nearest of a joint's lines.
double distance_to(const MovingBones& bones, const Eigen::Vector3d& point);

/// @throws InputError naming a vertex that is not finite
void require_finite_vertices(const Mesh& mesh);

/// @throws InputError as moving_bones
void require_joints(const Skeleton& skeleton);

}  // namespace anigen::rigging
