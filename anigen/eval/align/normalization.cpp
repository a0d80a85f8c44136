#include "anigen/eval/align/normalization.h"

#include <cmath>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

constexpr double kLargestCoordinate = 1e15;  // what the ray tracing structures accept

void check_points(const std::vector<Eigen::Vector3d>& points) {
  if (points.empty()) throw InputError("", "shape", "there is no point to normalise by");
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!(points[i].cwiseAbs().maxCoeff() <= kLargestCoordinate) || !points[i].allFinite()) {
      throw InputError("", "points[" + std::to_string(i) + "]", "the position is not finite or larger than 1e15");
    }
  }
}

SurfaceMoments point_moments(const std::vector<Eigen::Vector3d>& points) {
  SurfaceMoments moments;
  const Eigen::Vector3d origin = points[0];
  for (const Eigen::Vector3d& point : points) moments.centroid += point - origin;
  moments.centroid = origin + moments.centroid / static_cast<double>(points.size());
  double squared = 0.0;
  for (const Eigen::Vector3d& point : points) squared += (point - moments.centroid).squaredNorm();
  moments.rms_radius = std::sqrt(squared / static_cast<double>(points.size()));
  return moments;
}

/// `size` becomes 1 unless it is too small to divide by.
Similarity centred(const Eigen::Vector3d& center, double size) {
  Similarity result;
  if (size > 0.0 && std::isfinite(1.0 / size)) result.scale = 1.0 / size;
  result.translation = -result.scale * center;
  return result;
}

Similarity boxed(const std::vector<Eigen::Vector3d>& points) {
  Box box;
  for (const Eigen::Vector3d& point : points) box.extend(point);
  return centred(box.center(), box.longest_side());
}

}  // namespace

NormalizationMode normalization_mode(const std::string& word) {
  if (word == "centroid-rms") return NormalizationMode::kCentroidRms;
  if (word == "bounding-box") return NormalizationMode::kBoundingBox;
  if (word == "none") return NormalizationMode::kNone;
  throw InputError("", "normalization", "'" + word + "' is none of centroid-rms, bounding-box, none");
}

std::string to_string(NormalizationMode mode) {
  switch (mode) {
    case NormalizationMode::kCentroidRms:
      return "centroid-rms";
    case NormalizationMode::kBoundingBox:
      return "bounding-box";
    case NormalizationMode::kNone:
      break;
  }
  return "none";
}

SurfaceMoments surface_moments(const Mesh& mesh) {
  const std::vector<Eigen::Vector3d> points = transformed(Similarity{}, mesh.vertices);
  check_points(points);
  const auto corner = [&](std::size_t face, std::size_t k) -> const Eigen::Vector3d& {
    const std::int32_t index = mesh.faces[face][k];
    if (index < 0 || static_cast<std::size_t>(index) >= points.size()) {
      throw InputError(
          "", "mesh.faces[" + std::to_string(face) + "]",
          "vertex index " + std::to_string(index) + " is outside the " + std::to_string(points.size()) + " vertices");
    }
    return points[static_cast<std::size_t>(index)];
  };
  SurfaceMoments moments;
  std::vector<double> areas(mesh.faces.size());
  const Eigen::Vector3d origin = points[0];
  for (std::size_t f = 0; f < areas.size(); ++f) {
    const Eigen::Vector3d a = corner(f, 0) - origin, b = corner(f, 1) - origin, c = corner(f, 2) - origin;
    areas[f] = 0.5 * (b - a).cross(c - a).norm();
    moments.area += areas[f];
    moments.centroid += areas[f] / 3.0 * (a + b + c);
  }
  if (!(moments.area > 0.0)) return point_moments(points);
  moments.centroid = origin + moments.centroid / moments.area;
  double squared = 0.0;
  for (std::size_t f = 0; f < areas.size(); ++f) {
    const Eigen::Vector3d a = corner(f, 0) - moments.centroid, b = corner(f, 1) - moments.centroid,
                          c = corner(f, 2) - moments.centroid;
    // The mean of |x|² over a triangle.
    squared += areas[f] / 6.0 * (a.squaredNorm() + b.squaredNorm() + c.squaredNorm() + a.dot(b) + b.dot(c) + c.dot(a));
  }
  moments.rms_radius = std::sqrt(std::max(0.0, squared / moments.area));
  return moments;
}

Similarity normalization(const Mesh& mesh, NormalizationMode mode) {
  if (mode == NormalizationMode::kCentroidRms) {
    const SurfaceMoments moments = surface_moments(mesh);
    return centred(moments.centroid, moments.rms_radius);
  }
  return normalization(transformed(Similarity{}, mesh.vertices), mode);
}

Similarity normalization(const std::vector<Eigen::Vector3d>& points, NormalizationMode mode) {
  check_points(points);
  if (mode == NormalizationMode::kNone) return {};
  if (mode == NormalizationMode::kBoundingBox) return boxed(points);
  const SurfaceMoments moments = point_moments(points);
  return centred(moments.centroid, moments.rms_radius);
}

}  // namespace anigen::eval
