#include "anigen/geometry/visible_surface.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/core/numeric.h"
#include "anigen/geometry/ray_caster.h"

namespace anigen::geometry {

namespace {

constexpr std::size_t kDirections = 64;
constexpr double kStartOfRay = 1e-5;  ///< diagonals of the box: a ray does not meet the face that it starts on
constexpr double kPi = 3.14159265358979323846;

/// Even directions, by the golden angle. Every second one comes first, so that both halves of the sphere are tried
/// soon.
std::array<Eigen::Vector3d, kDirections> even_directions() {
  std::array<Eigen::Vector3d, kDirections> directions;
  const double golden_angle = kPi * (3.0 - std::sqrt(5.0));
  constexpr std::size_t kStride = 27;  // no divisor of kDirections, so every direction comes once
  for (std::size_t i = 0; i < kDirections; ++i) {
    const auto k = static_cast<double>(i * kStride % kDirections);
    const double z = 1.0 - (2.0 * k + 1.0) / static_cast<double>(kDirections);
    const double radius = std::sqrt(1.0 - z * z);
    directions[i] = {radius * std::cos(golden_angle * k), radius * std::sin(golden_angle * k), z};
  }
  return directions;
}

}  // namespace

FaceMarks seen_faces(const Mesh& mesh) {
  FaceMarks seen(mesh.faces.size(), 0);
  if (mesh.faces.empty()) return seen;
  const RayCaster rays(mesh);
  const double start = kStartOfRay * bounding_box(mesh.vertices).diagonal();
  static const std::array<Eigen::Vector3d, kDirections> directions = even_directions();
  const auto escapes = [&](const Eigen::Vector3d& point) {
    return std::any_of(directions.begin(), directions.end(), [&](const Eigen::Vector3d& direction) {
      return !rays.first_hit(point, direction, start).has_value();
    });
  };
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    std::array<Eigen::Vector3d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) corners[k] = mesh.vertices[at(mesh.faces[f][k])].cast<double>();
    const Eigen::Vector3d centre = (corners[0] + corners[1] + corners[2]) / 3.0;
    seen[f] = escapes(centre) || std::any_of(corners.begin(), corners.end(), [&](const Eigen::Vector3d& corner) {
                return escapes(0.5 * (centre + corner));
              });
  }
  return seen;
}

Mesh visible_surface(const Mesh& mesh) {
  const FaceMarks seen = seen_faces(mesh);
  const bool any = std::any_of(seen.begin(), seen.end(), [](char mark) { return mark != 0; });
  return chosen_faces(mesh.vertices, mesh.faces, any ? seen : FaceMarks(mesh.faces.size(), 1));
}

}  // namespace anigen::geometry
