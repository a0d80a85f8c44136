#include "anigen/metrics/deformation.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/metrics/skin_metrics.h"

namespace anigen::metrics {

std::vector<RigidMotion> rigid_motions(const JointTree& tree, const std::vector<int>& order,
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

namespace {

/// Both rigs in the poses of the true one.
class PosedRigs {
 public:
  PosedRigs(const JointTree& truth, const JointTree& predicted, const Eigen::MatrixXd& plan,
            const DeformationOptions& options)
      : truth_(truth),
        predicted_(predicted),
        options_(options),
        match_(strongest_match(plan)),
        order_(parents_first(truth)),
        predicted_order_(parents_first(predicted)) {}

  /// Of the true and of the predicted joints.
  std::pair<std::vector<RigidMotion>, std::vector<RigidMotion>> motions_of(int pose) const {
    std::vector<Eigen::Matrix3d> orientations = random_rotations(truth_.size(), options_, pose);
    for (const int j : order_) {
      const int parent = truth_.parents[at(j)];
      if (parent >= 0) orientations[at(j)] = orientations[at(parent)] * orientations[at(j)];
    }
    std::vector<Eigen::Matrix3d> predicted_orientations;
    for (const int k : match_) predicted_orientations.push_back(orientations[at(k)]);
    return {rigid_motions(truth_, order_, orientations),
            rigid_motions(predicted_, predicted_order_, predicted_orientations)};
  }

 private:
  const JointTree &truth_, &predicted_;
  const DeformationOptions& options_;
  std::vector<int> match_, order_, predicted_order_;
};

void check_skin(const SkinWeights& skin, std::size_t vertices, std::size_t joints, const char* which) {
  if (skin.rows() != vertices)
    throw InputError("", which, std::to_string(skin.rows()) + " rows for " + std::to_string(vertices) + " vertices");
  for (const Influence& influence : skin.influences) {
    if (influence.joint < 0 || at(influence.joint) >= joints)
      throw InputError("", which, "joint " + std::to_string(influence.joint) + " of " + std::to_string(joints));
    if (!(influence.weight > 0.0f) || !std::isfinite(influence.weight))
      throw InputError("", which, "a weight is not positive and finite");
  }
}

void check_input(const std::vector<Eigen::Vector3d>& vertices, const JointTree& truth, const JointTree& predicted,
                 const Eigen::MatrixXd& plan, const DeformationOptions& options) {
  check(truth, "");
  check(predicted, "");
  if (vertices.empty()) throw InputError("", "mesh", "there is no vertex to pose");
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (!vertices[v].allFinite()) throw InputError("", "vertex " + std::to_string(v), "the position is not finite");
  }
  if (plan.rows() != static_cast<Eigen::Index>(predicted.size()) ||
      plan.cols() != static_cast<Eigen::Index>(truth.size())) {
    throw InputError("", "transport plan",
                     std::to_string(plan.rows()) + " x " + std::to_string(plan.cols()) + " for " +
                         std::to_string(predicted.size()) + " predicted and " + std::to_string(truth.size()) +
                         " true joints");
  }
  if (options.poses < 1 || options.poses > 10000) throw InputError("", "poses", "expected 1 to 10000");
  if (!(options.probability >= 0.0 && options.probability <= 1.0))
    throw InputError("", "probability", "expected a number from 0 to 1");
  if (!(options.largest_angle_deg >= 0.0) || !std::isfinite(options.largest_angle_deg))
    throw InputError("", "largest angle", "expected a finite number that is not negative");
}

}  // namespace

std::vector<Eigen::Matrix3d> random_rotations(std::size_t joints, const DeformationOptions& options, int pose) {
  Rng rng(options.seed, "deformation", static_cast<std::uint64_t>(pose));
  std::vector<Eigen::Matrix3d> rotations(joints, Eigen::Matrix3d::Identity());
  for (Eigen::Matrix3d& rotation : rotations) {
    const bool turns = rng.chance(options.probability);
    const double z = rng.uniform(-1.0, 1.0), longitude = rng.uniform(0.0, 2.0 * kPi);
    const double angle = rng.uniform() * options.largest_angle_deg * kPi / 180.0;
    if (!turns) continue;
    const double radius = std::sqrt(1.0 - z * z);
    const Eigen::Vector3d axis(radius * std::cos(longitude), radius * std::sin(longitude), z);
    rotation = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
  }
  return rotations;
}

DeformationError deformation_error(const std::vector<Eigen::Vector3d>& vertices, const JointTree& truth,
                                   const SkinWeights& truth_skin, const JointTree& predicted,
                                   const SkinWeights& predicted_on_truth, const Eigen::MatrixXd& plan,
                                   const DeformationOptions& options) {
  check_input(vertices, truth, predicted, plan, options);
  check_skin(truth_skin, vertices.size(), truth.size(), "true skin");
  check_skin(predicted_on_truth, vertices.size(), predicted.size(), "predicted skin");
  const PosedRigs rigs(truth, predicted, plan, options);
  DeformationError error;
  for (int pose = 0; pose < options.poses; ++pose) {
    const auto [true_motions, predicted_motions] = rigs.motions_of(pose);
    double sum = 0;
    for (std::size_t v = 0; v < vertices.size(); ++v) {
      const double distance = (skinned(vertices[v], truth_skin, v, true_motions) -
                               skinned(vertices[v], predicted_on_truth, v, predicted_motions))
                                  .norm();
      sum += distance;
      error.max = std::max(error.max, distance);
    }
    error.mean += sum / static_cast<double>(vertices.size());
  }
  error.mean /= options.poses;
  return error;
}

PosedPair posed_pair(const io::RiggedShape& truth, const io::RiggedShape& predicted, const Eigen::MatrixXd& plan,
                     int pose, const DeformationOptions& options) {
  check_input(in_double(truth.mesh.vertices), truth.joints, predicted.joints, plan, options);
  check_input(in_double(predicted.mesh.vertices), truth.joints, predicted.joints, plan, options);
  check_skin(truth.skin, truth.mesh.vertices.size(), truth.joints.size(), "true skin");
  check_skin(predicted.skin, predicted.mesh.vertices.size(), predicted.joints.size(), "predicted skin");
  const auto [true_motions, predicted_motions] =
      PosedRigs(truth.joints, predicted.joints, plan, options).motions_of(pose);
  return {posed_vertices(truth, true_motions), posed_vertices(predicted, predicted_motions)};
}

}  // namespace anigen::metrics
