#include "anigen/metrics/matching.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/metrics/wasserstein.h"

namespace anigen::metrics {

namespace {

constexpr double kDepthShare = 1e-3;
constexpr double kParentWeight = 1e-9;

/// Position of the parent and depth in the tree.
struct Hanging {
  Eigen::Vector3d parent;
  double depth = 0;
};

std::vector<Hanging> hangings(const MetricSkeleton& tree) {
  std::vector<Hanging> result(tree.size());
  for (std::size_t j = 0; j < tree.size(); ++j) {
    const int parent = tree.parents[j];
    result[j].parent = tree.positions[parent < 0 ? j : static_cast<std::size_t>(parent)];
    for (int above = parent; above >= 0; above = tree.parents[at(above)]) result[j].depth += 1;
  }
  return result;
}

/// rows ≤ columns. @return the row of each column, -1 for a free one
std::vector<int> rows_of_columns(const RowMatrix& cost) {
  const Eigen::Index rows = cost.rows(), columns = cost.cols();
  const double infinity = std::numeric_limits<double>::infinity();
  Eigen::VectorXd row_potential = Eigen::VectorXd::Zero(rows), column_potential = Eigen::VectorXd::Zero(columns);
  std::vector<int> owner(static_cast<std::size_t>(columns), -1), previous(static_cast<std::size_t>(columns));
  std::vector<char> done(static_cast<std::size_t>(columns));
  std::vector<Eigen::Index> finished;
  Eigen::VectorXd distance(columns);
  for (Eigen::Index start = 0; start < rows; ++start) {
    // Dijkstra over columns by reduced cost, from the unmatched row to the nearest free column.
    std::fill(done.begin(), done.end(), 0);
    finished.clear();
    distance.setConstant(infinity);
    Eigen::Index row = start, sink = -1;
    int from = -1;
    double reached = 0;
    while (sink < 0) {
      Eigen::Index next = -1;
      double least = infinity;
      for (Eigen::Index c = 0; c < columns; ++c) {
        const auto at = static_cast<std::size_t>(c);
        if (done[at]) continue;
        const double through = reached + cost(row, c) - row_potential[row] - column_potential[c];
        if (through < distance[c]) {
          distance[c] = through;
          previous[at] = from;
        }
        // A free column of the same distance ends the search at once.
        if (distance[c] < least || (next >= 0 && distance[c] == least && owner[at] < 0)) {
          least = distance[c];
          next = c;
        }
      }
      // Rows are not more than columns, so only a cost that is not finite leaves nothing to go on with.
      if (next < 0) throw InputError("", "joint matching", "a cost is not finite");
      done[at(next)] = 1;
      reached = least;
      from = static_cast<int>(next);
      if (owner[at(next)] < 0) {
        sink = next;
      } else {
        finished.push_back(next);
        row = owner[at(next)];
      }
    }
    row_potential[start] += reached;
    for (const Eigen::Index c : finished) {
      row_potential[owner[at(c)]] += reached - distance[c];
      column_potential[c] -= reached - distance[c];
    }
    for (Eigen::Index c = sink; c >= 0;) {
      const int before = previous[at(c)];
      owner[at(c)] = before < 0 ? static_cast<int>(start) : owner[at(before)];
      c = before;
    }
  }
  return owner;
}

// Tie-breaking weight among coincident joints; far below any distance that matters.
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
  return matrix_of(n, m, [&](std::size_t i, std::size_t k) { return (predicted[i] - truth[k]).norm(); });
}

/// The pairs of an assignment that count.
JointMatch counted(std::vector<int> truth_of, const Eigen::MatrixXd& distance, const std::vector<double>& tolerance) {
  const auto n = static_cast<std::size_t>(distance.rows()), m = static_cast<std::size_t>(distance.cols());
  JointMatch match;
  match.truth_of = std::move(truth_of);
  for (std::size_t i = 0; i < n; ++i) {
    int& k = match.truth_of[i];
    if (k < 0) continue;
    if (distance(static_cast<Eigen::Index>(i), k) < tolerance[at(k)]) {
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

std::size_t bone_count(const MetricSkeleton& tree) { return tree.size() - roots(tree).size(); }

double share(std::size_t right, std::size_t bones, std::size_t other_bones) {
  if (bones == 0) return other_bones == 0 ? 1.0 : 0.0;
  return static_cast<double>(right) / static_cast<double>(bones);
}

}  // namespace

Eigen::MatrixXd joint_ties(const MetricSkeleton& predicted, const MetricSkeleton& truth) {
  const std::vector<Hanging> a = hangings(predicted), b = hangings(truth);
  return matrix_of(a.size(), b.size(), [&](std::size_t i, std::size_t k) {
    return (a[i].parent - b[k].parent).norm() + kDepthShare * std::abs(a[i].depth - b[k].depth);
  });
}

Eigen::MatrixXd matching_plan(const MetricSkeleton& predicted, const MetricSkeleton& truth) {
  const Eigen::MatrixXd cost =
      squared_distances(predicted.positions, truth.positions) + kParentWeight * joint_ties(predicted, truth);
  return exact_transport(cost, uniform_masses(predicted.size()), uniform_masses(truth.size())).plan;
}

std::vector<int> assign(const Eigen::MatrixXd& cost) {
  if (static_cast<double>(cost.rows()) * static_cast<double>(cost.cols()) > kLargestAssignment)
    throw InputError("", "joint matching", "too many joints on both sides to be matched one to one");
  if (!cost.allFinite()) throw InputError("", "joint matching", "a cost is not finite");
  std::vector<int> result(static_cast<std::size_t>(cost.rows()), -1);
  if (cost.size() == 0) return result;
  if (cost.rows() > cost.cols()) return rows_of_columns(cost.transpose());  // columns of rows, seen from the other side
  const std::vector<int> owner = rows_of_columns(cost);
  for (std::size_t c = 0; c < owner.size(); ++c) {
    if (owner[c] >= 0) result[at(owner[c])] = static_cast<int>(c);
  }
  return result;
}

JointMatch match_joints(const std::vector<Eigen::Vector3d>& predicted, const std::vector<Eigen::Vector3d>& truth,
                        const std::vector<double>& tolerance) {
  const Eigen::MatrixXd distance = distances(predicted, truth, tolerance);
  return counted(assign(distance), distance, tolerance);
}

JointMatch match_joints(const MetricSkeleton& predicted, const MetricSkeleton& truth,
                        const std::vector<double>& tolerance) {
  const Eigen::MatrixXd distance = distances(predicted.positions, truth.positions, tolerance);
  return counted(assign(distance + kTieWeight * joint_ties(predicted, truth)), distance, tolerance);
}

JointMatch match_joints(const std::vector<Eigen::Vector3d>& predicted, const std::vector<Eigen::Vector3d>& truth,
                        double tolerance) {
  return match_joints(predicted, truth, std::vector<double>(truth.size(), tolerance));
}

std::vector<double> joint_tolerances(const MetricSkeleton& truth, const geometry::RayCaster& surface, double fallback) {
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

ConnectivityScore connectivity(const MetricSkeleton& predicted, const MetricSkeleton& truth,
                               const std::vector<int>& truth_of) {
  if (truth_of.size() != predicted.size()) {
    throw InputError(
        "", "joint matching",
        std::to_string(truth_of.size()) + " matches for " + std::to_string(predicted.size()) + " predicted joints");
  }
  for (const int k : truth_of) {
    if (k < -1 || k >= static_cast<int>(truth.size()))
      throw InputError("", "joint matching", "match " + std::to_string(k) + " is not a true joint");
  }
  ConnectivityScore score;
  score.predicted_bones = bone_count(predicted);
  score.true_bones = bone_count(truth);
  for (std::size_t j = 0; j < predicted.size(); ++j) {
    if (predicted.parents[j] < 0) continue;
    const int a = truth_of[j], b = truth_of[at(predicted.parents[j])];
    if (a < 0 || b < 0) continue;
    score.right += truth.parents[at(a)] == b || truth.parents[at(b)] == a;
  }
  score.precision = share(score.right, score.predicted_bones, score.true_bones);
  score.recall = share(score.right, score.true_bones, score.predicted_bones);
  return score;
}

std::size_t joint_count_error(const MetricSkeleton& predicted, const MetricSkeleton& truth) {
  return predicted.size() > truth.size() ? predicted.size() - truth.size() : truth.size() - predicted.size();
}

}  // namespace anigen::metrics
