#include "anigen/metrics/similarity.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/metrics/surface.h"

namespace anigen::metrics {

Eigen::Matrix4d Similarity::matrix() const {
  Eigen::Matrix4d result = Eigen::Matrix4d::Identity();
  result.topLeftCorner<3, 3>() = scale * rotation;
  result.topRightCorner<3, 1>() = translation;
  return result;
}

Similarity Similarity::inverse() const {
  Similarity result;
  result.scale = 1.0 / scale;
  result.rotation = rotation.transpose();
  result.translation = -result.scale * (result.rotation * translation);
  return result;
}

Similarity compose(const Similarity& left, const Similarity& right) {
  return {left.scale * right.scale, left.rotation * right.rotation, left(right.translation)};
}

double rotation_angle(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  // The arc cosine of the trace loses half the digits near 0; the chord does not. |A − B| = √8 |sin(angle / 2)|.
  return 2.0 * std::asin(std::min(1.0, (a - b).norm() / std::sqrt(8.0)));
}

std::vector<Eigen::Vector3d> transformed(const Similarity& similarity, std::vector<Eigen::Vector3d> points) {
  for (Eigen::Vector3d& point : points) point = similarity(point);
  return points;
}

std::vector<Eigen::Vector3d> transformed(const Similarity& similarity, const std::vector<Eigen::Vector3f>& points) {
  return transformed(similarity, in_double(points));
}

JointTree transformed(const Similarity& similarity, JointTree joints) {
  joints.positions = transformed(similarity, std::move(joints.positions));
  return joints;
}

Mesh transformed(const Similarity& similarity, Mesh mesh) {
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex = similarity(vertex.cast<double>()).cast<float>();
  for (Eigen::Vector3f& normal : mesh.normals) normal = (similarity.rotation * normal.cast<double>()).cast<float>();
  return mesh;
}

io::RiggedShape transformed(const Similarity& similarity, io::RiggedShape shape) {
  shape.mesh = transformed(similarity, std::move(shape.mesh));
  shape.joints = transformed(similarity, std::move(shape.joints));
  return shape;
}

void ProcrustesSums::add(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double weight) {
  if (empty_) {
    from_origin_ = from;
    to_origin_ = to;
    empty_ = false;
  }
  const Eigen::Vector3d a = from - from_origin_, b = to - to_origin_;
  weight_ += weight;
  from_ += weight * a;
  to_ += weight * b;
  from_squared_ += weight * a.squaredNorm();
  to_squared_ += weight * b.squaredNorm();
  cross_ += weight * a * b.transpose();
}

Similarity ProcrustesSums::solve(PairScale scale) const {
  if (!(weight_ > 0.0)) throw InputError("", "pairs", "there is nothing to align: no pair has a positive weight");
  const Eigen::Vector3d from_mean = from_ / weight_, to_mean = to_ / weight_;
  const Eigen::Matrix3d covariance = cross_ / weight_ - from_mean * to_mean.transpose();
  const double from_variance = from_squared_ / weight_ - from_mean.squaredNorm();
  const double to_variance = to_squared_ / weight_ - to_mean.squaredNorm();

  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign = Eigen::Vector3d::Ones();
  if ((svd.matrixV() * svd.matrixU().transpose()).determinant() < 0.0) sign.z() = -1.0;
  Similarity result;
  result.rotation = svd.matrixV() * sign.asDiagonal() * svd.matrixU().transpose();
  double found = 1.0;
  if (scale == PairScale::kLeastSquares) found = svd.singularValues().dot(sign) / from_variance;
  if (scale == PairScale::kSizeRatio) found = std::sqrt(to_variance / from_variance);
  if (std::isfinite(found) && found > 0.0) result.scale = found;
  result.translation = to_origin_ + to_mean - result.scale * (result.rotation * (from_origin_ + from_mean));
  return result;
}

Similarity procrustes(const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to, PairScale scale,
                      const std::vector<double>& weights) {
  if (from.size() != to.size() || (!weights.empty() && weights.size() != from.size())) {
    throw InputError("", "pairs",
                     std::to_string(from.size()) + " points cannot be paired with " + std::to_string(to.size()) +
                         " points and " + std::to_string(weights.size()) + " weights");
  }
  ProcrustesSums sums;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const double weight = weights.empty() ? 1.0 : weights[i];
    if (!from[i].allFinite() || !to[i].allFinite() || !(weight >= 0.0) || !std::isfinite(weight))
      throw InputError("", "pairs[" + std::to_string(i) + "]", "a position or weight is not finite or negative");
    sums.add(from[i], to[i], weight);
  }
  return sums.solve(scale);
}

namespace {

constexpr const char* kAlignmentPurpose = "alignment samples";
constexpr std::size_t kCoarsePoints = 1000;

}  // namespace

AlignmentShape::AlignmentShape(const Mesh& mesh, std::size_t samples, std::uint64_t seed) {
  if (samples == 0) throw InputError("", "samples", "at least one sample is needed to align by");
  surface_ = std::make_unique<geometry::NearestSurface>(mesh);
  SurfaceSamples drawn = sample_mesh(mesh, samples, seed, kAlignmentPurpose);
  points_ = std::move(drawn.points);
  normals_ = std::move(drawn.normals);
  finish();
}

AlignmentShape::AlignmentShape(std::vector<Eigen::Vector3d> points, std::size_t samples, std::uint64_t seed) {
  if (samples == 0) throw InputError("", "samples", "at least one sample is needed to align by");
  if (points.empty()) throw InputError("", "points", "there is no point to align by");
  Rng rng(seed, kAlignmentPurpose);
  std::vector<std::size_t> order = rng.permutation(points.size());
  order.resize(std::min(samples, order.size()));
  for (const std::size_t i : order) points_.push_back(points[i]);
  normals_.assign(points_.size(), Eigen::Vector3d::Zero());
  finish();
}

void AlignmentShape::finish() {
  index_ = std::make_unique<geometry::PointIndex>(points_);
  const auto coarse = static_cast<std::ptrdiff_t>(std::min(kCoarsePoints, points_.size()));
  coarse_ =
      std::make_unique<geometry::PointIndex>(std::vector<Eigen::Vector3d>(points_.begin(), points_.begin() + coarse));
  const auto count = static_cast<double>(points_.size());
  for (const Eigen::Vector3d& point : points_) centroid_ += point / count;
  for (const Eigen::Vector3d& point : points_)
    covariance_ += (point - centroid_) * (point - centroid_).transpose() / count;
  rms_radius_ = std::sqrt(covariance_.trace());
}

}  // namespace anigen::metrics
