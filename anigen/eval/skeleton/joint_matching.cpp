#include "anigen/eval/skeleton/joint_matching.h"

#include <Eigen/Geometry>
#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/eval/skeleton/assignment.h"
#include "anigen/eval/skeleton/joint_ties.h"

namespace anigen::eval {
namespace {

// What settles which of several joints in one place is which; far below any distance that matters.
constexpr double kTieWeight = 1e-6;
constexpr double kNearestHit = 1e-6;  // a joint on the surface must not measure the surface it lies on

struct RayLengths {
  double sum = 0;
  int count = 0;
};

void cast_around(const Eigen::Vector3d& joint, const Eigen::Vector3d& axis, const geometry::RayCaster& surface,
                 RayLengths& lengths) {
  const Eigen::Vector3d u = axis.unitOrthogonal(), v = axis.cross(u);
  for (int k = 0; k < kToleranceRays; ++k) {
    const double angle = 2.0 * kPi * k / kToleranceRays;
    const auto hit = surface.first_hit(joint, std::cos(angle) * u + std::sin(angle) * v, kNearestHit);
    if (!hit) continue;
    lengths.sum += *hit;
    ++lengths.count;
  }
}

/// Euclidean distances [n, m]. @throws InputError for no joints, lengths that differ, or too many joints
Eigen::MatrixXd distances(const std::vector<Eigen::Vector3d>& predicted, const std::vector<Eigen::Vector3d>& truth,
                          const std::vector<double>& tolerance) {
  const std::size_t n = predicted.size(), m = truth.size();
  if (n == 0 || m == 0) throw InputError("", "joint matching", "a skeleton has no joint");
  if (tolerance.size() != m) {
    throw InputError("", "joint matching",
                     std::to_string(tolerance.size()) + " tolerances for " + std::to_string(m) + " joints");
  }
  // Before the matrix is allocated.
  if (static_cast<double>(n) * static_cast<double>(m) > kLargestAssignment)
    throw InputError("", "joint matching", "too many joints on both sides to be matched one to one");
  Eigen::MatrixXd distance(n, m);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < m; ++k)
      distance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = (predicted[i] - truth[k]).norm();
  }
  return distance;
}

/// The pairs of an assignment that count.
JointMatch counted(std::vector<int> truth_of, const Eigen::MatrixXd& distance, const std::vector<double>& tolerance) {
  const auto n = static_cast<std::size_t>(distance.rows()), m = static_cast<std::size_t>(distance.cols());
  JointMatch match;
  match.truth_of = std::move(truth_of);
  for (std::size_t i = 0; i < n; ++i) {
    int& k = match.truth_of[i];
    if (k < 0) continue;
    if (distance(static_cast<Eigen::Index>(i), k) < tolerance[static_cast<std::size_t>(k)]) {
      ++match.matched;
    } else {
      k = -1;
    }
  }
  const auto pairs = static_cast<double>(match.matched);
  match.iou = 2.0 * pairs / static_cast<double>(n + m);
  match.precision = pairs / static_cast<double>(n);
  match.recall = pairs / static_cast<double>(m);
  return match;
}

}  // namespace

JointMatch match_joints(const std::vector<Eigen::Vector3d>& predicted, const std::vector<Eigen::Vector3d>& truth,
                        const std::vector<double>& tolerance) {
  const Eigen::MatrixXd distance = distances(predicted, truth, tolerance);
  return counted(assign(distance), distance, tolerance);
}

JointMatch match_joints(const io::JointTree& predicted, const io::JointTree& truth,
                        const std::vector<double>& tolerance) {
  check(predicted, "predicted skeleton");
  check(truth, "true skeleton");
  const Eigen::MatrixXd distance = distances(predicted.positions, truth.positions, tolerance);
  return counted(assign(distance + kTieWeight * joint_ties(predicted, truth)), distance, tolerance);
}

JointMatch match_joints(const std::vector<Eigen::Vector3d>& predicted, const std::vector<Eigen::Vector3d>& truth,
                        double tolerance) {
  return match_joints(predicted, truth, std::vector<double>(truth.size(), tolerance));
}

std::vector<double> joint_tolerances(const io::JointTree& truth, const geometry::RayCaster& surface, double fallback) {
  check(truth, "");
  std::vector<RayLengths> lengths(truth.size());
  std::vector<char> has_bone(truth.size(), 0);
  for (std::size_t child = 0; child < truth.size(); ++child) {
    if (truth.parents[child] < 0) continue;
    const auto parent = static_cast<std::size_t>(truth.parents[child]);
    const Eigen::Vector3d along = truth.positions[child] - truth.positions[parent];
    const double length = along.stableNorm();
    if (!(length > 0.0) || !std::isfinite(length)) continue;
    for (const std::size_t joint : {parent, child}) {
      has_bone[joint] = 1;
      cast_around(truth.positions[joint], along / length, surface, lengths[joint]);
    }
  }
  std::vector<double> tolerances(truth.size(), fallback);
  for (std::size_t j = 0; j < truth.size(); ++j) {
    if (!has_bone[j]) {
      for (int axis = 0; axis < 3; ++axis)
        cast_around(truth.positions[j], Eigen::Vector3d::Unit(axis), surface, lengths[j]);
    }
    if (lengths[j].count > 0) tolerances[j] = lengths[j].sum / lengths[j].count;
  }
  return tolerances;
}

}  // namespace anigen::eval
