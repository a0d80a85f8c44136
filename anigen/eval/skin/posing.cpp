#include "anigen/eval/skin/posing.h"

#include "anigen/core/numeric.h"

namespace anigen::eval {

std::vector<int> parents_first(const io::JointTree& tree) {
  std::vector<std::vector<int>> children(tree.size());
  std::vector<int> order = roots(tree);
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (tree.parents[j] >= 0) children[at(tree.parents[j])].push_back(static_cast<int>(j));
  }
  for (std::size_t i = 0; i < order.size(); ++i) {
    const std::vector<int>& next = children[at(order[i])];
    order.insert(order.end(), next.begin(), next.end());
  }
  return order;
}

std::vector<RigidMotion> rigid_motions(const io::JointTree& tree, const std::vector<int>& order,
                                       const std::vector<Eigen::Matrix3d>& orientations) {
  std::vector<RigidMotion> result(tree.size());
  std::vector<Eigen::Vector3d> posed(tree.positions);
  for (const int j : order) {
    const int parent = tree.parents[at(j)];
    if (parent >= 0) {
      posed[at(j)] =
          posed[at(parent)] + orientations[at(parent)] * (tree.positions[at(j)] - tree.positions[at(parent)]);
    }
    result[at(j)].turn = orientations[at(j)];
    result[at(j)].shift = posed[at(j)] - orientations[at(j)] * tree.positions[at(j)];
  }
  return result;
}

Eigen::Vector3d skinned(const Eigen::Vector3d& vertex, const SkinWeights& skin, std::size_t v,
                        const std::vector<RigidMotion>& joints) {
  if (skin.row_size(v) == 0) return joints[0](vertex);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double weights = 0;
  for (std::size_t i = 0; i < skin.row_size(v); ++i) {
    const Influence& influence = skin.row(v)[i];
    const RigidMotion& motion = joints[at(influence.joint)];
    sum += static_cast<double>(influence.weight) * motion(vertex);
    weights += static_cast<double>(influence.weight);
  }
  return sum / weights;  // weights in single precision sum to 1 only to 1e-7
}

std::vector<Eigen::Vector3f> posed_vertices(const io::RiggedShape& shape, const std::vector<RigidMotion>& joints) {
  std::vector<Eigen::Vector3f> posed;
  for (std::size_t v = 0; v < shape.mesh.vertices.size(); ++v)
    posed.push_back(skinned(shape.mesh.vertices[v].cast<double>(), shape.skin, v, joints).cast<float>());
  return posed;
}

}  // namespace anigen::eval
