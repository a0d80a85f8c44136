#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/random.h"
#include "anigen/geometry/surface_point.h"

namespace anigen::geometry {

/// Probability of each face: its area, clamped to at least 1e-12, over the sum; uniform when any area is not finite
/// (reference training-and-data.md, sampled skin rows of the SkinAE trainer).
std::vector<double> face_probabilities(const std::vector<Eigen::Vector3f>& vertices,
                                       const std::vector<Triangle>& faces);

/// Draws `count` points on the surface with replacement: a face by face_probabilities(), then barycentrics
/// (1 − √u, √u (1 − v), √u v) with u, v uniform in [0, 1) — uniform over the surface. Draws face, u, v per point in
/// that order from `rng`, so the first points do not depend on `count`.
/// @throws InputError without faces or on a bad vertex index (count 0 gives an empty result)
std::vector<SurfacePoint> sample_surface(const std::vector<Eigen::Vector3f>& vertices,
                                         const std::vector<Triangle>& faces, std::size_t count, Rng& rng);

}  // namespace anigen::geometry
