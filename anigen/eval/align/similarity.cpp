#include "anigen/eval/align/similarity.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace anigen::eval {

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
  std::vector<Eigen::Vector3d> result;
  result.reserve(points.size());
  for (const Eigen::Vector3f& point : points) result.push_back(similarity(point.cast<double>()));
  return result;
}

io::JointTree transformed(const Similarity& similarity, io::JointTree joints) {
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

}  // namespace anigen::eval
