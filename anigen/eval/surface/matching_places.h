#pragma once
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/surface_point.h"

namespace anigen::eval {

/// For every vertex of `to` the place on `from` that it corresponds to, after the two were aligned: the nearest place.
///
/// Where several parts of `from` touch or coincide (clothes, nested parts, shells, copies of a mesh), a vertex lies on
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
std::vector<geometry::SurfacePoint> matching_places(const Mesh& from, const Mesh& to);

}  // namespace anigen::eval
