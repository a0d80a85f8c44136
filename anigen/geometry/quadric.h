#pragma once
#include <Eigen/Core>
#include <Eigen/LU>

namespace anigen::geometry {

/// A quadratic form x ↦ xᵀ A x − 2 bᵀ x + c that measures squared distances, for edge collapse (Garland and Heckbert
/// 1997). Frame and unit are those of the points.
struct Quadric {
  Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  double c = 0.0;

  /// weight · squared distance to the plane through `point` with that unit normal.
  static Quadric plane(const Eigen::Vector3d& normal, const Eigen::Vector3d& point, double weight) {
    const double offset = normal.dot(point);
    return {weight * normal * normal.transpose(), weight * offset * normal, weight * offset * offset};
  }
  /// weight · squared distance to the point.
  static Quadric point(const Eigen::Vector3d& point, double weight) {
    return {weight * Eigen::Matrix3d::Identity(), weight * point, weight * point.squaredNorm()};
  }

  Quadric& operator+=(const Quadric& other) {
    a += other.a;
    b += other.b;
    c += other.c;
    return *this;
  }
  friend Quadric operator+(Quadric first, const Quadric& second) { return first += second; }

  /// Never negative: rounding is cut off.
  double operator()(const Eigen::Vector3d& x) const {
    const double value = x.dot(a * x) - 2.0 * b.dot(x) + c;
    return value > 0.0 ? value : 0.0;
  }
  /// Where the form is least. @pre A is invertible, as with any point() in the sum
  Eigen::Vector3d minimum() const { return a.inverse() * b; }
};

}  // namespace anigen::geometry
