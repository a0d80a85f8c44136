#include "anigen/eval/align/alignment_shape.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/eval/surface/surface_samples.h"

namespace anigen::eval {
namespace {

constexpr const char* kPurpose = "alignment samples";
constexpr std::size_t kCoarsePoints = 1000;

}  // namespace

AlignmentShape::AlignmentShape(const Mesh& mesh, std::size_t samples, std::uint64_t seed) {
  if (samples == 0) throw InputError("", "samples", "at least one sample is needed to align by");
  surface_ = std::make_unique<geometry::NearestSurface>(mesh);
  SurfaceSamples drawn = sample_mesh(mesh, samples, seed, kPurpose);
  points_ = std::move(drawn.points);
  normals_ = std::move(drawn.normals);
  finish();
}

AlignmentShape::AlignmentShape(std::vector<Eigen::Vector3d> points, std::size_t samples, std::uint64_t seed) {
  if (samples == 0) throw InputError("", "samples", "at least one sample is needed to align by");
  if (points.empty()) throw InputError("", "points", "there is no point to align by");
  Rng rng(seed, kPurpose);
  std::vector<std::size_t> order = rng.permutation(points.size());
  order.resize(std::min(samples, order.size()));
  for (const std::size_t i : order) points_.push_back(points[i]);
  normals_.assign(points_.size(), Eigen::Vector3d::Zero());
  finish();
}

void AlignmentShape::finish() {
  index_ = std::make_unique<PointIndex>(points_);
  const auto coarse = static_cast<std::ptrdiff_t>(std::min(kCoarsePoints, points_.size()));
  coarse_ = std::make_unique<PointIndex>(std::vector<Eigen::Vector3d>(points_.begin(), points_.begin() + coarse));
  const auto count = static_cast<double>(points_.size());
  for (const Eigen::Vector3d& point : points_) centroid_ += point / count;
  for (const Eigen::Vector3d& point : points_) {
    covariance_ += (point - centroid_) * (point - centroid_).transpose() / count;
  }
  rms_radius_ = std::sqrt(covariance_.trace());
}

}  // namespace anigen::eval
