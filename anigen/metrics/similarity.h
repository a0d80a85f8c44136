#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/geometry/nearest_point.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::metrics {

/// x → scale · rotation · x + translation: what alignment may do to a prediction. No reflection: det(rotation) = 1.
struct Similarity {
  double scale = 1.0;  ///< > 0
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator()(const Eigen::Vector3d& point) const { return scale * (rotation * point) + translation; }
  Eigen::Matrix4d matrix() const;
  Similarity inverse() const;
};

/// First `right`, then `left`: compose(left, right)(x) = left(right(x)).
Similarity compose(const Similarity& left, const Similarity& right);

/// Angle between two rotations, radians in [0, π].
double rotation_angle(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b);

std::vector<Eigen::Vector3d> transformed(const Similarity& similarity, std::vector<Eigen::Vector3d> points);
/// The vertices in double precision, before they are rounded back.
std::vector<Eigen::Vector3d> transformed(const Similarity& similarity, const std::vector<Eigen::Vector3f>& points);
JointTree transformed(const Similarity& similarity, JointTree joints);
/// Vertices move, normals turn; the rest stays.
Mesh transformed(const Similarity& similarity, Mesh mesh);
/// Mesh and joints.
io::RiggedShape transformed(const Similarity& similarity, io::RiggedShape shape);

/// Scaling of a transform between paired points.
enum class PairScale {
  kFixed,         ///< 1: rigid
  kLeastSquares,  ///< what minimises the squared distances together with the rotation (Umeyama 1991); ICP's
  kSizeRatio      ///< the ratio of the point sets' RMS radii, the same seen from either side (trimesh's)
};

/// Weighted pairs from → to, reduced to sums as they arrive, so that ICP need not store them. Sums are taken relative
/// to the first pair: far-away coordinates do not cancel.
class ProcrustesSums {
 public:
  void add(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double weight = 1.0);

  /// The transform T that minimises Σ w |T(from) − to|² (Kabsch 1976), never a reflection; with kSizeRatio that among
  /// transforms of this scale. Where several are optimal — coincident or collinear pairs — one of them, always the same
  /// for the same pairs; coincident ones give no rotation. A scale that the pairs do not define (no extent on either
  /// side) is 1. @throws InputError when the weights sum to nothing
  Similarity solve(PairScale scale) const;

 private:
  double weight_ = 0.0, from_squared_ = 0.0, to_squared_ = 0.0;
  Eigen::Vector3d from_origin_ = Eigen::Vector3d::Zero(), to_origin_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d from_ = Eigen::Vector3d::Zero(), to_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d cross_ = Eigen::Matrix3d::Zero();  ///< Σ w from toᵀ
  bool empty_ = true;
};

/// ProcrustesSums over paired rows. @param weights one per pair, ≥ 0; empty: all 1
/// @throws InputError when lengths differ, there is no pair, a number is not finite or a weight is negative
Similarity procrustes(const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to, PairScale scale,
                      const std::vector<double>& weights = {});

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
  const geometry::PointIndex& coarse_index() const { return *coarse_; }       ///< over the first points, at most 1,000
  const geometry::PointIndex& index() const { return *index_; }               ///< over all points
  const geometry::NearestSurface* surface() const { return surface_.get(); }  ///< null for a bare set of points

  const Eigen::Vector3d& centroid() const { return centroid_; }
  double rms_radius() const { return rms_radius_; }  ///< of the points around the centroid
  const Eigen::Matrix3d& covariance() const { return covariance_; }

 private:
  void finish();

  std::vector<Eigen::Vector3d> points_, normals_;
  std::unique_ptr<geometry::PointIndex> coarse_, index_;
  std::unique_ptr<geometry::NearestSurface> surface_;
  Eigen::Vector3d centroid_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance_ = Eigen::Matrix3d::Zero();
  double rms_radius_ = 0.0;
};

}  // namespace anigen::metrics
