#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/random.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::geometry {

/// Probability of each face: its area, clamped to at least 1e-12, over the sum; uniform when any area is not finite
/// (docs/reference/training.md, 3.1).
std::vector<double> face_probabilities(const std::vector<Eigen::Vector3f>& vertices,
                                       const std::vector<Triangle>& faces);

/// Draws `count` points on the surface with replacement: a face by face_probabilities(), then barycentrics
/// (1 − √u, √u (1 − v), √u v) with u, v uniform in [0, 1) — uniform over the surface. Draws face, u, v per point in
/// that order from `rng`, so the first points do not depend on `count`.
/// @throws InputError without faces or on a bad vertex index (count 0 gives an empty result)
std::vector<SurfacePoint> sample_surface(const std::vector<Eigen::Vector3f>& vertices,
                                         const std::vector<Triangle>& faces, std::size_t count, Rng& rng);

/// The points' indices along a Morton curve of 1,024³ cells through their box: neighbours in the list are mostly
/// neighbours in space. Points of one cell keep their order. At most 2³² points, which must be finite.
std::vector<std::uint32_t> along_curve(const std::vector<Eigen::Vector3d>& points);

}  // namespace anigen::geometry
