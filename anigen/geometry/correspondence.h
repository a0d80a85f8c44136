#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::geometry {

/// For every vertex of `to` the place on `from` that it corresponds to, after the two were aligned: the nearest place.
///
/// When several parts of `from` touch or coincide (clothes, nested parts, shells, copies of a mesh), a vertex lies on
/// all of them, and the nearest place is whichever rounding prefers, although each may carry other weights. Places
/// within 1e-6 of the size of `from` of the nearest are therefore told apart by shape: the one is taken whose
/// surroundings on `from` continue like the vertex' surroundings on `to`. In figures: every face f around the
/// vertex v looks among the faces g around the place for the one that suits it best, by
///     d(p_f, g) / |p_f − v| + ½ (1 − n_f · n_g),   p_f a little way from v towards the middle of f,
/// and the mean over f, weighted by area, says how much of one side is missing on the other. Taken both ways, the place
/// with the least of the lesser number wins, since a seam in either mesh splits surroundings without changing the
/// shape; among places equal in this, the one with the least of the greater. Normals are those of faces,
/// counter-clockwise side out. What is left equal within 0.001 cannot be told apart by local shape, as whole copies
/// cannot: of c equal places the k-th vertex of `to` that has this choice, in the order of vertices, takes place k mod
/// c, in the order of `from`.
///
/// Looks at geometry alone, never at weights: a prediction gets no benefit of the doubt. A mesh corresponds to itself
/// vertex by vertex, and a mesh without coinciding places is looked up as by geometry::NearestSurface.
/// @throws InputError when `from` has no faces, an index is bad, or a position is not finite
std::vector<SurfacePoint> matching_places(const Mesh& from, const Mesh& to);

/// Skin weights of one mesh at the points of another that was aligned to it: at each point the weights of the nearest
/// place on the surface, interpolated barycentrically (docs/reference/training.md, 7.4). One row per point, over the
/// source's joints. Runs on the calling thread.
/// @param faces,skin of the mesh that `surface` was made from, one row per vertex
/// @throws InputError when rows are missing or a point is not finite
SkinWeights transfer_skin(const NearestSurface& surface, const std::vector<Triangle>& faces, const SkinWeights& skin,
                          const std::vector<Eigen::Vector3d>& points);
/// @throws InputError also when the mesh has no faces
SkinWeights transfer_skin(const Mesh& mesh, const SkinWeights& skin, const std::vector<Eigen::Vector3d>& points);

/// Overload for the vertices of a mesh, whose faces settle which place is meant where several coincide: see
/// matching_places(). This is how predicted weights come to the ground truth.
SkinWeights transfer_skin_to_mesh(const Mesh& mesh, const SkinWeights& skin, const Mesh& to);

/// For comparison, and for shapes without faces: the row of the nearest vertex. Coarse triangles make it blocky.
/// @throws InputError without vertices, when rows are missing or a number is not finite
SkinWeights transfer_skin_by_vertex(const std::vector<Eigen::Vector3d>& vertices, const SkinWeights& skin,
                                    const std::vector<Eigen::Vector3d>& points);

/// Attributes that a mesh had at its vertices, for the vertices of a mesh made from it.
struct TransferredAttributes {
  SkinWeights skin;                     ///< one row per point; no rows when there were none
  std::vector<Eigen::Vector4f> colors;  ///< one per point; empty when there were none
};

/// Skin weights and vertex colours of a mesh at points near it, such as the vertices of the same mesh after it was
/// simplified: at each point those of the nearest place on the surface, interpolated barycentrically
/// (docs/reference/flows.md, 5.6). Runs on all threads.
/// @param skin one row per vertex of `from`, or no rows
/// @throws InputError when `from` has no faces, skin or colours have another length than its vertices, or a position is
/// not finite
TransferredAttributes transfer_attributes(const Mesh& from, const SkinWeights& skin,
                                          const std::vector<Eigen::Vector3f>& points);

}  // namespace anigen::geometry
