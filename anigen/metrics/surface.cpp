#include "anigen/metrics/surface.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/core/text.h"
#include "anigen/geometry/nearest_point.h"
#include "anigen/geometry/sampling.h"

namespace anigen::metrics {

SurfaceSamples sample_mesh(const Mesh& mesh, std::size_t count, std::uint64_t seed, std::string_view purpose) {
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (!mesh.vertices[v].allFinite())
      throw InputError("", "mesh.vertices[" + std::to_string(v) + "]", "the position is not finite");
  }
  Rng rng(seed, purpose);
  SurfaceSamples samples;
  samples.points.reserve(count);
  samples.normals.reserve(count);
  samples.faces.reserve(count);
  for (const geometry::SurfacePoint& place : geometry::sample_surface(mesh.vertices, mesh.faces, count, rng)) {
    const Triangle& face = mesh.faces[at(place.face)];
    Eigen::Vector3d point = Eigen::Vector3d::Zero();
    for (std::size_t k = 0; k < 3; ++k)
      point += place.barycentric[static_cast<Eigen::Index>(k)] * mesh.vertices[at(face[k])].cast<double>();
    samples.points.push_back(point);
    samples.normals.push_back(face_normal(mesh.vertices, face));
    samples.faces.push_back(place.face);
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

namespace {

const Words<SurfaceDistance> kSurfaceDistances = {{SurfaceDistance::kSampleToSurface, "sample-to-surface"},
                                                  {SurfaceDistance::kSampleToSample, "sample-to-sample"}};

void nearest_all(const std::vector<Eigen::Vector3d>& from, const geometry::PointIndex& index,
                 std::vector<double>& distances, std::vector<std::size_t>& nearest) {
  distances.resize(from.size());
  nearest.resize(from.size());
  for (std::size_t i = 0; i < from.size(); ++i) {
    const geometry::PointIndex::Nearest found = index.nearest(from[i]);
    distances[i] = std::sqrt(found.squared);
    nearest[i] = found.index;
  }
}

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double mean_square(const std::vector<double>& values) {
  return std::inner_product(values.begin(), values.end(), values.begin(), 0.0) / static_cast<double>(values.size());
}

double share_within(const std::vector<double>& values, double threshold) {
  const auto within = std::count_if(values.begin(), values.end(), [&](double value) { return value < threshold; });
  return static_cast<double>(within) / static_cast<double>(values.size());
}

double mean_cosine(const std::vector<Eigen::Vector3d>& normals, const std::vector<Eigen::Vector3d>& others,
                   const std::vector<std::size_t>& nearest) {
  double sum = 0.0;
  for (std::size_t i = 0; i < normals.size(); ++i) sum += std::abs(normals[i].dot(others[nearest[i]]));
  return sum / static_cast<double>(normals.size());
}

constexpr const char* kSurfacePurpose = "surface metrics";
constexpr double kFineThreshold = 0.01, kWideThreshold = 0.05;

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
    cosines += std::abs(samples.normals[i].dot(face_normal(other.vertices, other.faces[at(guess)])));
  }
  return cosines / static_cast<double>(distances.size());
}

/// Without faces that no sample falls on, unless there are no others: what is no surface for one side is none for the
/// other.
Mesh faces_with_area(const Mesh& mesh) {
  constexpr double kThinnest = 1e-12;  // of the square of the longest edge: rounding of a line
  Mesh result;
  result.vertices = mesh.vertices;
  for (const auto& face : mesh.faces) {
    const auto is_bad = [&](std::int32_t index) { return index < 0 || at(index) >= mesh.vertices.size(); };
    if (std::any_of(face.begin(), face.end(), is_bad)) return mesh;  // refused when samples are drawn
    const Eigen::Vector3d a = mesh.vertices[at(face[0])].cast<double>(), b = mesh.vertices[at(face[1])].cast<double>(),
                          c = mesh.vertices[at(face[2])].cast<double>();
    const double longest = std::max({(b - a).squaredNorm(), (c - a).squaredNorm(), (c - b).squaredNorm()});
    if ((b - a).cross(c - a).norm() > kThinnest * longest) result.faces.push_back(face);
  }
  return result.faces.empty() ? mesh : result;
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
  return sorted_by_face(sample_mesh(mesh, options.samples, options.seed, kSurfacePurpose));
}

SurfaceScores between_samples(const SurfaceSamples& a, const SurfaceSamples& b) {
  const CloudDistances distances = cloud_distances(a.points, b.points);
  return scores(distances, normal_consistency(distances, a.normals, b.normals));
}

}  // namespace

CloudDistances cloud_distances(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b) {
  const geometry::PointIndex index_a(a), index_b(b);
  CloudDistances distances;
  nearest_all(a, index_b, distances.to_b, distances.nearest_b);
  nearest_all(b, index_a, distances.to_a, distances.nearest_a);
  return distances;
}

double chamfer_l1(const CloudDistances& distances) { return 0.5 * (mean(distances.to_b) + mean(distances.to_a)); }

double chamfer_l2(const CloudDistances& distances) { return mean_square(distances.to_b) + mean_square(distances.to_a); }

double hausdorff(const CloudDistances& distances) {
  return std::max(*std::max_element(distances.to_b.begin(), distances.to_b.end()),
                  *std::max_element(distances.to_a.begin(), distances.to_a.end()));
}

FScore fscore(const CloudDistances& distances, double threshold) {
  if (!(threshold > 0.0)) throw InputError("", "threshold", "must be positive");
  FScore result;
  result.precision = share_within(distances.to_b, threshold);
  result.recall = share_within(distances.to_a, threshold);
  const double sum = result.precision + result.recall;
  result.fscore = sum > 0.0 ? 2.0 * result.precision * result.recall / sum : 0.0;
  return result;
}

double normal_consistency(const CloudDistances& distances, const std::vector<Eigen::Vector3d>& a_normals,
                          const std::vector<Eigen::Vector3d>& b_normals) {
  if (a_normals.size() != distances.to_b.size() || b_normals.size() != distances.to_a.size()) {
    throw InputError("", "normals",
                     "there must be one per point: " + std::to_string(a_normals.size()) + " for " +
                         std::to_string(distances.to_b.size()) + " points, " + std::to_string(b_normals.size()) +
                         " for " + std::to_string(distances.to_a.size()));
  }
  return 0.5 * (mean_cosine(a_normals, b_normals, distances.nearest_b) +
                mean_cosine(b_normals, a_normals, distances.nearest_a));
}

SurfaceDistance surface_distance(const std::string& word) {
  return value_of(kSurfaceDistances, word, "surface_distance");
}

std::string to_string(SurfaceDistance definition) { return word_of(kSurfaceDistances, definition); }

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
  if (options.definition == SurfaceDistance::kSampleToSample)
    return between_samples(draw(prediction, options), draw(truth, options));
  const Mesh a = faces_with_area(prediction), b = faces_with_area(truth);
  return surface_scores(a, geometry::NearestSurface(a), b, geometry::NearestSurface(b), options);
}

}  // namespace anigen::metrics
