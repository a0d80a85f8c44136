#include "anigen/metrics/alignment.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"

namespace anigen::metrics {

namespace {

const Words<NormalizationMode> kNormalizationModes = {{NormalizationMode::kCentroidRms, "centroid-rms"},
                                                      {NormalizationMode::kBoundingBox, "bounding-box"},
                                                      {NormalizationMode::kTruth, "truth"},
                                                      {NormalizationMode::kTruthWithJoints, "truth-with-joints"},
                                                      {NormalizationMode::kNone, "none"}};

constexpr double kLargestCoordinate = 1e15;  // what the ray tracing structures accept

void check_points(const std::vector<Eigen::Vector3d>& points) {
  if (points.empty()) throw InputError("", "shape", "there is no point to normalise by");
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!(points[i].cwiseAbs().maxCoeff() <= kLargestCoordinate) || !points[i].allFinite())
      throw InputError("", "points[" + std::to_string(i) + "]", "the position is not finite or larger than 1e15");
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

AlignedBy common_ground(const io::RiggedShape& a, const io::RiggedShape& b) {
  if (a.has_surface() && b.has_surface()) return AlignedBy::kSurface;
  if (!a.mesh.vertices.empty() && !b.mesh.vertices.empty()) return AlignedBy::kVertices;
  if (a.has_joints() && b.has_joints()) return AlignedBy::kJoints;
  const io::RiggedShape& poorer = a.has_joints() ? b : a;
  throw InputError(poorer.file, "", "there is nothing to align by: the two shapes share neither a mesh nor joints");
}

Similarity normalize(const io::RiggedShape& shape, NormalizationMode mode, AlignedBy by) {
  try {
    return by == AlignedBy::kJoints ? normalization(shape.joints.positions, mode) : normalization(shape.mesh, mode);
  } catch (const InputError& error) {
    throw InputError(shape.file, error.place(), error.problem());
  }
}

/// By the box of vertices and joints.
Similarity normalize_with_joints(const io::RiggedShape& shape) {
  std::vector<Eigen::Vector3d> points = in_double(shape.mesh.vertices);
  points.insert(points.end(), shape.joints.positions.begin(), shape.joints.positions.end());
  try {
    return normalization(points, NormalizationMode::kBoundingBox);
  } catch (const InputError& error) {
    throw InputError(shape.file, error.place(), error.problem());
  }
}

AlignmentShape prepare(const io::RiggedShape& shape, const Similarity& normalized, AlignedBy by,
                       const IcpOptions& options) {
  const std::size_t samples = std::max(options.samples, options.score_samples);
  if (by == AlignedBy::kJoints) {
    return {transformed(normalized, shape.joints.positions), samples, options.seed};
  }
  if (shape.has_surface()) {
    Mesh mesh;
    mesh.vertices = shape.mesh.vertices;
    mesh.faces = shape.mesh.faces;
    return {transformed(normalized, std::move(mesh)), samples, options.seed};
  }
  return {transformed(normalized, shape.mesh.vertices), samples, options.seed};
}

}  // namespace

NormalizationMode normalization_mode(const std::string& word) {
  return value_of(kNormalizationModes, word, "normalization");
}

std::string to_string(NormalizationMode mode) { return word_of(kNormalizationModes, mode); }

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
    return points[at(index)];
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
  if (mode != NormalizationMode::kCentroidRms) {
    Box box;
    for (const Eigen::Vector3d& point : points) box.extend(point);
    return centred(box.center(), box.longest_side());
  }
  const SurfaceMoments moments = point_moments(points);
  return centred(moments.centroid, moments.rms_radius);
}

std::string to_string(AlignedBy by) {
  return word_of({{AlignedBy::kSurface, "surface"}, {AlignedBy::kVertices, "vertices"}, {AlignedBy::kJoints, "joints"}},
                 by);
}

Alignment align(const io::RiggedShape& prediction, const io::RiggedShape& truth, const AlignmentOptions& options) {
  check(options.registration);
  Alignment result;
  result.by = common_ground(prediction, truth);
  const NormalizationMode mode = options.normalization;
  const bool with_joints = mode == NormalizationMode::kTruthWithJoints;
  const bool is_common = mode == NormalizationMode::kTruth || with_joints;
  const Similarity to = with_joints ? normalize_with_joints(truth) : normalize(truth, mode, result.by);
  const Similarity from = is_common ? to : normalize(prediction, mode, result.by);
  const bool raw = mode == NormalizationMode::kNone;
  // Joints alone bring the two together, but the unit of scores stays that of the truth's mesh.
  const AlignedBy unit = truth.mesh.vertices.empty() ? result.by : AlignedBy::kVertices;
  result.truth = raw || is_common ? to : normalize(truth, NormalizationMode::kBoundingBox, unit);
  const Similarity to_scores = compose(result.truth, to.inverse());
  if (options.icp) {
    result.icp = register_shapes(prepare(prediction, from, result.by, options.registration),
                                 prepare(truth, to, result.by, options.registration), options.registration);
    result.icp.rmse *= to_scores.scale;
    result.icp.runner_up *= to_scores.scale;
    result.icp_used = true;
  }
  result.prediction = compose(to_scores, compose(result.icp.transform, from));
  return result;
}

}  // namespace anigen::metrics
