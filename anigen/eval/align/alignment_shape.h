#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/eval/surface/point_index.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::eval {

/// One side of an alignment, prepared once: area-uniform samples of a surface with search structures over the samples
/// and over the surface itself; or a bare set of points (vertices without faces, joints). Queries are thread-safe.
/// Samples are drawn from (seed, "alignment samples"), the same stream for every shape: two copies of one mesh get the
/// same places on their faces.
class AlignmentShape {
 public:
  /// @throws InputError without faces, on a bad index or a vertex that is not finite; when `samples` is 0
  AlignmentShape(const Mesh& mesh, std::size_t samples, std::uint64_t seed);
  /// Takes at most `samples` of the points, drawn without replacement. @throws InputError without points
  AlignmentShape(std::vector<Eigen::Vector3d> points, std::size_t samples, std::uint64_t seed);

  /// In random order: the first n are a fair sample.
  const std::vector<Eigen::Vector3d>& points() const { return points_; }
  /// Unit normals of the samples; zero vectors where there is no surface.
  const std::vector<Eigen::Vector3d>& normals() const { return normals_; }
  const PointIndex& coarse_index() const { return *coarse_; }                 ///< over the first points, at most 1,000
  const PointIndex& index() const { return *index_; }                         ///< over all points
  const geometry::NearestSurface* surface() const { return surface_.get(); }  ///< null for a bare set of points

  const Eigen::Vector3d& centroid() const { return centroid_; }
  double rms_radius() const { return rms_radius_; }  ///< of the points around the centroid
  const Eigen::Matrix3d& covariance() const { return covariance_; }

 private:
  void finish();

  std::vector<Eigen::Vector3d> points_, normals_;
  std::unique_ptr<PointIndex> coarse_, index_;
  std::unique_ptr<geometry::NearestSurface> surface_;
  Eigen::Vector3d centroid_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance_ = Eigen::Matrix3d::Zero();
  double rms_radius_ = 0.0;
};

}  // namespace anigen::eval
