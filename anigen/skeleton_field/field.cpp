#include "anigen/skeleton_field/field.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/nn/init.h"

namespace anigen::skeleton_field {

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

std::vector<float> confidences_of(const Tensor& confidence, std::int64_t votes, const char* name) {
  if (!confidence.defined()) return {};
  nn::require_matrix(confidence, votes, 1, name);
  const Tensor values = confidence.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  return {values.data_ptr<float>(), values.data_ptr<float>() + values.numel()};
}

// Below it a joint counts as having no voxels.
constexpr double kLeastWeight = 1e-6;

/// The nearest joint of each centre. @return [M] int64 on the device of the centres
Tensor owners_of(const Tensor& centers, const Tensor& joints) {
  const std::vector<NearestJoints> nearest =
      nearest_joints(nn::points_of<double>(centers, "positions"), nn::points_of<double>(joints, "joints"));
  const Tensor owners = torch::empty({static_cast<std::int64_t>(nearest.size())}, torch::kInt64);
  auto* next = owners.data_ptr<std::int64_t>();
  for (const NearestJoints& joint : nearest) *next++ = joint.joint;
  return nn::to_device(owners, centers.device());
}

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

Votes votes_of(const SkeletonField& field) {
  Votes votes;
  votes.joints = nn::points_of<float>(field.joints, "joints");
  nn::require_matrix(field.parents, field.joints.size(0), 3, "parents");
  votes.parents = nn::points_of<float>(field.parents, "parents");
  votes.joint_confidence = confidences_of(field.conf_j, field.joints.size(0), "conf_j");
  votes.parent_confidence = confidences_of(field.conf_p, field.joints.size(0), "conf_p");
  return votes;
}

SkeletonTensors group_votes(const SkeletonField& field, const std::string& strategy, const MeanShiftOptions& mean_shift,
                            const ThresholdOptions& threshold) {
  if (strategy != "mean_shift" && strategy != "threshold")
    throw InputError("", "", "no grouping is called '" + strategy + "': mean_shift or threshold");
  const Votes votes = votes_of(field);
  const GroupedSkeleton skeleton =
      strategy == "mean_shift" ? mean_shift_grouping(votes, mean_shift) : threshold_grouping(votes, threshold);
  const auto count = static_cast<std::int64_t>(skeleton.joints.size());
  SkeletonTensors tensors{torch::empty({count, 3}, torch::kFloat32), torch::empty({count}, torch::kInt64)};
  float* joints = tensors.joints.data_ptr<float>();
  auto* parents = tensors.parents.data_ptr<std::int64_t>();
  for (std::size_t j = 0; j < skeleton.joints.size(); ++j) {
    for (const float x : skeleton.joints[j]) *joints++ = x;
    *parents++ = skeleton.parents[j];
  }
  const torch::Device device = field.joints.device();
  return {nn::to_device(tensors.joints, device), nn::to_device(tensors.parents, device)};
}

JointSkinFeatures joint_skin_features(const SkeletonField& field, const Tensor& joints) {
  nn::require_matrix(field.positions, -1, 3, "positions");
  nn::require_matrix(joints, -1, 3, "joints");
  const std::int64_t voxels = field.positions.size(0), count = joints.size(0);
  if (!field.skin_features.defined() || field.skin_features.dim() != 2 || field.skin_features.size(0) != voxels)
    throw InputError("", "skin_features", "expected one row per centre, got " + nn::shape_text(field.skin_features));
  if (field.conf_skin.defined()) nn::require_matrix(field.conf_skin, voxels, 1, "conf_skin");
  const torch::Dtype dtype = nn::accumulation_dtype(field.skin_features.scalar_type());
  const Tensor features = field.skin_features.to(dtype);
  if (count == 0) return {features.new_zeros({0, features.size(1)}), features.new_zeros({})};

  const Tensor owners = owners_of(field.positions, joints);
  const Tensor weights =
      field.conf_skin.defined() ? torch::sigmoid(field.conf_skin.to(dtype)) : features.new_ones({voxels, 1});
  const auto sum_by_joint = [&](const Tensor& rows) {
    return rows.new_zeros({count, rows.size(1)}).index_add(0, owners, rows);
  };
  // W^j = Σ c f / Σ c over the voxels that j owns, and the variance Σ c f² / Σ c − (W^j)².
  const Tensor weighted = weights * features;
  const Tensor totals = sum_by_joint(weights).clamp_min(kLeastWeight);
  const Tensor mean = sum_by_joint(weighted) / totals;
  const Tensor mean_square = sum_by_joint(weighted * features) / totals;
  return {mean, (mean_square - mean.square()).mean()};
}

}  // namespace anigen::skeleton_field
