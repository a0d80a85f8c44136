#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/io/rigs/joint_tree.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

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
io::JointTree transformed(const Similarity& similarity, io::JointTree joints);
/// Vertices move, normals turn; the rest stays.
Mesh transformed(const Similarity& similarity, Mesh mesh);
/// Mesh and joints.
io::RiggedShape transformed(const Similarity& similarity, io::RiggedShape shape);

}  // namespace anigen::eval
