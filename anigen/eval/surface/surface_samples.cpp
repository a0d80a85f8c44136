#include "anigen/eval/surface/surface_samples.h"

#include <algorithm>
#include <numeric>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/geometry/surface_sampling.h"

namespace anigen::eval {

SurfaceSamples sample_mesh(const Mesh& mesh, std::size_t count, std::uint64_t seed, std::string_view purpose) {
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (!mesh.vertices[v].allFinite()) {
      throw InputError("", "mesh.vertices[" + std::to_string(v) + "]", "the position is not finite");
    }
  }
  Rng rng(seed, purpose);
  SurfaceSamples samples;
  samples.points.reserve(count);
  samples.normals.reserve(count);
  samples.faces.reserve(count);
  for (const geometry::SurfacePoint& at : geometry::sample_surface(mesh.vertices, mesh.faces, count, rng)) {
    const Triangle& face = mesh.faces[static_cast<std::size_t>(at.face)];
    const Eigen::Vector3d a = mesh.vertices[static_cast<std::size_t>(face[0])].cast<double>(),
                          b = mesh.vertices[static_cast<std::size_t>(face[1])].cast<double>(),
                          c = mesh.vertices[static_cast<std::size_t>(face[2])].cast<double>();
    const Eigen::Vector3d normal = (b - a).cross(c - a);
    const double length = normal.norm();
    samples.points.push_back(at.barycentric[0] * a + at.barycentric[1] * b + at.barycentric[2] * c);
    samples.normals.push_back(length > 0.0 ? Eigen::Vector3d(normal / length) : Eigen::Vector3d::Zero());
    samples.faces.push_back(at.face);
  }
  return samples;
}

SurfaceSamples sorted_by_face(const SurfaceSamples& samples) {
  std::vector<std::size_t> order(samples.faces.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) {
    return samples.faces[i] != samples.faces[j] ? samples.faces[i] < samples.faces[j] : i < j;
  });
  SurfaceSamples result;
  for (const std::size_t i : order) {
    result.points.push_back(samples.points[i]);
    result.normals.push_back(samples.normals[i]);
    result.faces.push_back(samples.faces[i]);
  }
  return result;
}

}  // namespace anigen::eval
