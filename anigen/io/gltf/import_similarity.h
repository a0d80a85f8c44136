#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

#include "anigen/asset/skeleton.h"

namespace anigen::io::gltf_import {

/// x → scale · rotation · x + translation; a negative scale mirrors. Multiplying a T · R · S transform from the left
/// by one of these gives a T · R · S transform again, exactly, so static nodes between joints can be folded away.
struct FoldedTransform {
  double scale = 1.0;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  FoldedTransform operator*(const FoldedTransform& right) const;
  Transform operator*(const Transform& right) const;
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const;
  Eigen::Matrix4d matrix() const;
};

/// @return nothing when the matrix shears, scales unevenly (by more than 1e-5) or collapses space
std::optional<FoldedTransform> as_similarity(const Eigen::Matrix4d& matrix);

/// glTF's Y-up axes to ours, (X, Y, Z) → (X, −Z, Y): a rotation by 90° about X.
FoldedTransform y_up_to_z_up();

}  // namespace anigen::io::gltf_import
