#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::eval {

/// Points on a surface with the unit normals of their faces, counter-clockwise side out.
struct SurfaceSamples {
  std::vector<Eigen::Vector3d> points, normals;
  std::vector<std::int32_t> faces;
};

/// Draws area-uniform points from the stream (seed, purpose, 0): geometry::sample_surface, in the order drawn, so that
/// the first n of more are again a uniform sample. A point on a face without area has the normal 0.
/// @throws InputError without faces, on a bad index or a position that is not finite
SurfaceSamples sample_mesh(const Mesh& mesh, std::size_t count, std::uint64_t seed, std::string_view purpose);

/// The same points, ordered by face: neighbours in the list are neighbours on the surface, which makes long runs of
/// nearest-point queries quicker. For sums over all samples, which do not care.
SurfaceSamples sorted_by_face(const SurfaceSamples& samples);

}  // namespace anigen::eval
