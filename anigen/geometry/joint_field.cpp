#include "anigen/geometry/joint_field.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"

namespace anigen::geometry {
namespace {

constexpr std::size_t kPointsPerTask = 256;  // points at a time

void require_usable(const std::vector<Eigen::Vector3d>& points, const std::string& name) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    // Beyond it, squared distances would be infinite.
    if (points[i].allFinite() && points[i].cwiseAbs().maxCoeff() <= 1e100) continue;
    throw InputError("", name + "[" + std::to_string(i) + "]", "not finite, or beyond 1e100");
  }
}

/// Joints in order of the coordinate along which they spread most: a search that starts beside the point and goes
/// outward both ways may stop where that coordinate alone is further than the second best.
class SortedJoints {
 public:
  explicit SortedJoints(const std::vector<Eigen::Vector3d>& joints) {
    Eigen::Vector3d low = joints[0], high = joints[0];
    for (const Eigen::Vector3d& joint : joints) {
      low = low.cwiseMin(joint);
      high = high.cwiseMax(joint);
    }
    (high - low).maxCoeff(&axis_);
    original_.resize(joints.size());
    std::iota(original_.begin(), original_.end(), 0);
    const auto along = [&](int j) { return joints[static_cast<std::size_t>(j)][axis_]; };
    std::stable_sort(original_.begin(), original_.end(), [&](int a, int b) { return along(a) < along(b); });
    for (const int j : original_) sorted_.push_back(joints[static_cast<std::size_t>(j)]);
  }

  NearestJoints nearest(const Eigen::Vector3d& point) const {
    const auto found = std::lower_bound(sorted_.begin(), sorted_.end(), point[axis_],
                                        [&](const Eigen::Vector3d& joint, double x) { return joint[axis_] < x; });
    Search search{point};
    auto up = static_cast<std::size_t>(found - sorted_.begin()), down = up;  // down is one past the next one below
    bool more_up = true, more_down = true;
    while (more_up || more_down) {
      more_up = more_up && up < sorted_.size() && offer(search, up++);
      more_down = more_down && down > 0 && offer(search, --down);
    }
    if (sorted_.size() == 1) search.best.second = 0.0;
    return search.best;
  }

 private:
  struct Search {
    Eigen::Vector3d point;
    NearestJoints best{-1, std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  };

  /// @return whether joints further out on this side may still matter
  bool offer(Search& search, std::size_t at) const {
    const double along = sorted_[at][axis_] - search.point[axis_];
    NearestJoints& best = search.best;
    if (along * along > best.second) return false;
    const double squared = (sorted_[at] - search.point).squaredNorm();
    if (squared < best.first || (squared == best.first && original_[at] < best.joint)) {
      best.second = best.first;
      best.first = squared;
      best.joint = original_[at];
    } else {
      best.second = std::min(best.second, squared);
    }
    return true;
  }

  int axis_ = 0;
  std::vector<Eigen::Vector3d> sorted_;
  std::vector<int> original_;
};

double sigmoid(double x) { return 1.0 / (1.0 + std::exp(-x)); }

}  // namespace

std::vector<NearestJoints> nearest_joints(const std::vector<Eigen::Vector3d>& points,
                                          const std::vector<Eigen::Vector3d>& joints) {
  if (joints.empty()) throw InputError("", "joints", "there is no joint to be near to");
  require_usable(joints, "joints");
  require_usable(points, "points");
  const SortedJoints sorted(joints);
  std::vector<NearestJoints> result(points.size());
  parallel_for((points.size() + kPointsPerTask - 1) / kPointsPerTask, [&](std::size_t block) {
    const std::size_t end = std::min(points.size(), (block + 1) * kPointsPerTask);
    for (std::size_t p = block * kPointsPerTask; p < end; ++p) result[p] = sorted.nearest(points[p]);
  });
  return result;
}

double joint_confidence(const NearestJoints& nearest) {
  return 1.0 - std::min(1.0, nearest.first / (nearest.second + 1e-8));
}

double target_confidence(const NearestJoints& nearest) { return std::max(0.1, joint_confidence(nearest)); }

std::vector<JointFieldPoint> joint_field(const std::vector<Eigen::Vector3d>& points,
                                         const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents,
                                         RootParent root) {
  if (joints.size() != parents.size()) {
    throw InputError("", "parents",
                     std::to_string(joints.size()) + " joints but " + std::to_string(parents.size()) + " parents");
  }
  for (std::size_t j = 0; j < parents.size(); ++j) {
    if (parents[j] >= -1 && parents[j] < static_cast<int>(joints.size())) continue;
    throw InputError("", "parents[" + std::to_string(j) + "]", "there is no joint " + std::to_string(parents[j]));
  }
  const std::vector<NearestJoints> nearest = nearest_joints(points, joints);
  const std::size_t stand_in = root == RootParent::kFirstJoint ? 0 : joints.size() - 1;
  std::vector<JointFieldPoint> field(points.size());
  for (std::size_t p = 0; p < points.size(); ++p) {
    const auto joint = static_cast<std::size_t>(nearest[p].joint);
    const int parent = parents[joint];
    const std::size_t seen = parent < 0 ? stand_in : static_cast<std::size_t>(parent);
    field[p] = {nearest[p].joint, parent, joints[joint] - points[p], joints[seen] - points[p],
                joint_confidence(nearest[p])};
  }
  return field;
}

JointVote joint_vote(const Eigen::Vector3d& center, const std::array<double, 8>& channels) {
  return {center + Eigen::Vector3d(channels[0], channels[1], channels[2]),
          center + Eigen::Vector3d(channels[3], channels[4], channels[5]), sigmoid(channels[6]), sigmoid(channels[7])};
}

}  // namespace anigen::geometry
