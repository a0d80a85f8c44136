#include "anigen/eval/surface/point_cloud_metrics.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/eval/surface/point_index.h"

namespace anigen::eval {
namespace {

void nearest_all(const std::vector<Eigen::Vector3d>& from, const PointIndex& index, std::vector<double>& distances,
                 std::vector<std::size_t>& nearest) {
  distances.resize(from.size());
  nearest.resize(from.size());
  for (std::size_t i = 0; i < from.size(); ++i) {
    const PointIndex::Nearest found = index.nearest(from[i]);
    distances[i] = std::sqrt(found.squared);
    nearest[i] = found.index;
  }
}

double mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

double mean_square(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value * value;
  return sum / static_cast<double>(values.size());
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

}  // namespace

CloudDistances cloud_distances(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b) {
  const PointIndex index_a(a), index_b(b);
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

}  // namespace anigen::eval
