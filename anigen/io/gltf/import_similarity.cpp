#include "anigen/io/gltf/import_similarity.h"

#include <Eigen/LU>
#include <cmath>

namespace anigen::io::gltf_import {

FoldedTransform FoldedTransform::operator*(const FoldedTransform& right) const {
  return {scale * right.scale, (rotation * right.rotation).normalized(), *this * right.translation};
}

Transform FoldedTransform::operator*(const Transform& right) const {
  Transform result;
  result.translation = *this * right.translation;
  result.rotation = (rotation * right.rotation).normalized();
  result.scale = scale * right.scale;
  return result;
}

Eigen::Vector3d FoldedTransform::operator*(const Eigen::Vector3d& point) const {
  return scale * (rotation * point) + translation;
}

Eigen::Matrix4d FoldedTransform::matrix() const { return (*this * Transform()).matrix(); }

std::optional<FoldedTransform> as_similarity(const Eigen::Matrix4d& matrix) {
  const Eigen::Matrix3d linear = matrix.topLeftCorner<3, 3>();
  const double determinant = linear.determinant();
  const double scale = std::cbrt(determinant);
  if (!(std::abs(scale) > 1e-12) || !std::isfinite(scale)) return std::nullopt;
  // An improper similarity is a negative scale times a rotation, so the quotient is a rotation in both cases.
  const Eigen::Matrix3d rotation = linear / scale;
  if ((rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() > 1e-5) return std::nullopt;
  return FoldedTransform{scale, Eigen::Quaterniond(rotation).normalized(), matrix.topRightCorner<3, 1>()};
}

FoldedTransform y_up_to_z_up() {
  const double half = std::sqrt(0.5);
  return {1.0, Eigen::Quaterniond(half, half, 0.0, 0.0), Eigen::Vector3d::Zero()};
}

}  // namespace anigen::io::gltf_import
