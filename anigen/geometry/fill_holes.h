#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

struct BoundaryLoops {
  /// Vertices along each hole, at least three and none twice, in the direction of the sides of the faces around it: a
  /// face that closes part of the hole has to run against it. Where holes touch themselves in a vertex they are
  /// several.
  std::vector<std::vector<std::int32_t>> loops;
  std::size_t broken = 0;  ///< borders that run into an edge of more than two faces or along faces that disagree about
                           ///< which side is up: they surround nothing that a face could close
};

/// The closed walks along edges with one face. @param edges of these faces @pre no face names a vertex twice
BoundaryLoops boundary_loops(const std::vector<Triangle>& faces, const MeshEdges& edges);

/// A hole as a closed polygon and what surrounds it.
struct HoleOutline {
  std::vector<Eigen::Vector3d> points;   ///< [n] along the hole, against the direction of the faces around it
  std::vector<Eigen::Vector3d> outside;  ///< [n] unit normal of the face beyond the edge from point i to the next
  /// True when an edge between two points of the outline that are not next to each other may be made.
  std::function<bool(std::int32_t, std::int32_t)> may_connect;
};

/// The triangulation of a hole without new points that bends least: the one with the smallest of the largest angles
/// between faces that share an edge, of equal ones the one with the least area (Barequet and Sharir 1995 with the
/// weights of Liepa 2003). Time grows with n³, memory with n².
/// @return n − 2 triangles of indices into the outline, in its direction; empty when the forbidden edges leave none
/// @pre at least 3 points
std::vector<Triangle> triangulate_hole(const HoleOutline& hole);

/// Triangles that close a hole.
struct HolePatch {
  std::vector<Eigen::Vector3d> points;  ///< those of the outline first, in its order
  std::vector<Triangle> faces;
  std::int32_t outline = 0;  ///< how many points belong to the outline
};

/// Gives a patch triangles of about the size of those around it: adds points in the middle of large triangles and turns
/// edges towards larger angles, until neither has anything to do (Liepa 2003, section 4). The outline stays.
/// @param scale how long edges should be at each of the patch's points: the mean of the surface around it
/// @param may_connect whether an edge between two points of the outline may be made
void refine_patch(HolePatch& patch, std::vector<double> scale,
                  const std::function<bool(std::int32_t, std::int32_t)>& may_connect);

struct HoleFilling {
  std::size_t most_edges = 32;  ///< along the border of a hole that is closed; others stay open
  bool refine = true;           ///< give patches triangles of the size of those around them, which adds vertices
};

struct FilledMesh {
  Mesh mesh;                  ///< vertices and faces alone; the old ones first and in their order, then the new
  std::size_t filled = 0;     ///< holes that were closed
  std::size_t left_open = 0;  ///< loops that are too long, or whose only patch is a face that exists already
  std::size_t broken = 0;     ///< borders that surround nothing that could be closed, see BoundaryLoops
};

/// Closes the small holes of a surface as the published pipeline does after it removes hidden faces (reference
/// flows-and-pipeline.md, 5.8, step 7): each loop of border edges is triangulated so that it bends least, then refined
/// (Liepa 2003). Never makes an edge of more than two faces: where a hole cannot be triangulated by its own points
/// without one, its faces meet in a new point in its middle. Faces that name a vertex twice are dropped, vertices
/// without faces are kept. Deterministic; runs on the calling thread.
/// @throws InputError when a face refers to a missing vertex
FilledMesh fill_holes(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                      const HoleFilling& options = {});

}  // namespace anigen::geometry
