#include "anigen/eval/surface/surface_metrics.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/eval/surface/point_cloud_metrics.h"
#include "anigen/eval/surface/surface_samples.h"

namespace anigen::eval {
namespace {

constexpr const char* kPurpose = "surface metrics";
constexpr double kFineThreshold = 0.01, kWideThreshold = 0.05;

Eigen::Vector3d face_normal(const Mesh& mesh, std::int32_t face) {
  const Triangle& corners = mesh.faces[static_cast<std::size_t>(face)];
  const Eigen::Vector3d a = mesh.vertices[static_cast<std::size_t>(corners[0])].cast<double>(),
                        b = mesh.vertices[static_cast<std::size_t>(corners[1])].cast<double>(),
                        c = mesh.vertices[static_cast<std::size_t>(corners[2])].cast<double>();
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  const double length = normal.norm();
  return length > 0.0 ? Eigen::Vector3d(normal / length) : Eigen::Vector3d::Zero();
}

/// Distances of samples to the other surface. @return mean |cosine| between the normals
double measure(const SurfaceSamples& samples, const Mesh& other, const geometry::NearestSurface& surface,
               std::vector<double>& distances) {
  distances.resize(samples.points.size());
  double cosines = 0.0;
  std::int32_t guess = 0;
  for (std::size_t i = 0; i < distances.size(); ++i) {
    const geometry::NearestPoint nearest = surface.query(samples.points[i], guess);
    guess = nearest.at.face;
    distances[i] = nearest.distance;
    cosines += std::abs(samples.normals[i].dot(face_normal(other, guess)));
  }
  return cosines / static_cast<double>(distances.size());
}

SurfaceScores scores(const CloudDistances& distances, double consistency) {
  SurfaceScores result;
  result.chamfer = chamfer_l1(distances);
  result.hausdorff = hausdorff(distances);
  const FScore fine = fscore(distances, kFineThreshold), wide = fscore(distances, kWideThreshold);
  result.fscore_001 = fine.fscore;
  result.precision_001 = fine.precision;
  result.recall_001 = fine.recall;
  result.fscore_005 = wide.fscore;
  result.precision_005 = wide.precision;
  result.recall_005 = wide.recall;
  result.normal_consistency = consistency;
  return result;
}

SurfaceSamples draw(const Mesh& mesh, const SurfaceOptions& options) {
  if (options.samples == 0) throw InputError("", "samples", "at least one sample is needed");
  return sorted_by_face(sample_mesh(mesh, options.samples, options.seed, kPurpose));
}

SurfaceScores between_samples(const SurfaceSamples& a, const SurfaceSamples& b) {
  const CloudDistances distances = cloud_distances(a.points, b.points);
  return scores(distances, normal_consistency(distances, a.normals, b.normals));
}

}  // namespace

SurfaceDistance surface_distance(const std::string& word) {
  if (word == "sample-to-surface") return SurfaceDistance::kSampleToSurface;
  if (word == "sample-to-sample") return SurfaceDistance::kSampleToSample;
  throw InputError("", "surface_distance", "'" + word + "' is neither sample-to-surface nor sample-to-sample");
}

std::string to_string(SurfaceDistance definition) {
  return definition == SurfaceDistance::kSampleToSurface ? "sample-to-surface" : "sample-to-sample";
}

SurfaceScores surface_scores(const Mesh& prediction, const geometry::NearestSurface& prediction_surface,
                             const Mesh& truth, const geometry::NearestSurface& truth_surface,
                             const SurfaceOptions& options) {
  const SurfaceSamples a = draw(prediction, options), b = draw(truth, options);
  if (options.definition == SurfaceDistance::kSampleToSample) return between_samples(a, b);
  CloudDistances distances;
  const double forth = measure(a, truth, truth_surface, distances.to_b);
  const double back = measure(b, prediction, prediction_surface, distances.to_a);
  return scores(distances, 0.5 * (forth + back));
}

SurfaceScores surface_scores(const Mesh& prediction, const Mesh& truth, const SurfaceOptions& options) {
  if (options.definition == SurfaceDistance::kSampleToSample) {
    return between_samples(draw(prediction, options), draw(truth, options));
  }
  return surface_scores(prediction, geometry::NearestSurface(prediction), truth, geometry::NearestSurface(truth),
                        options);
}

}  // namespace anigen::eval
