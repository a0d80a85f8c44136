#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::eval {

/// Skin weights of one mesh at the points of another that was aligned to it: at each point the weights of the nearest
/// place on the surface, interpolated barycentrically (reference training-and-data.md, 7.4). One row per point, over
/// the source's joints. Runs on the calling thread.
/// @param faces,skin of the mesh that `surface` was made from, one row per vertex
/// @throws InputError when rows are missing or a point is not finite
SkinWeights transfer_skin(const geometry::NearestSurface& surface, const std::vector<Triangle>& faces,
                          const SkinWeights& skin, const std::vector<Eigen::Vector3d>& points);
/// @throws InputError also when the mesh has no faces
SkinWeights transfer_skin(const Mesh& mesh, const SkinWeights& skin, const std::vector<Eigen::Vector3d>& points);

/// The same at the vertices of a mesh, whose faces settle which place is meant where several coincide: see
/// matching_places.h. This is how predicted weights come to the ground truth.
SkinWeights transfer_skin_to_mesh(const Mesh& mesh, const SkinWeights& skin, const Mesh& to);

/// For comparison, and for shapes without faces: the row of the nearest vertex. Coarse triangles make it blocky.
/// @throws InputError without vertices, when rows are missing or a number is not finite
SkinWeights transfer_skin_by_vertex(const std::vector<Eigen::Vector3d>& vertices, const SkinWeights& skin,
                                    const std::vector<Eigen::Vector3d>& points);

}  // namespace anigen::eval
