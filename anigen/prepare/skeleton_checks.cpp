#include "anigen/prepare/skeleton_checks.h"

#include <algorithm>

namespace anigen::prepare {

double closest_bones(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents) {
  std::vector<Eigen::Vector3d> bones;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (parents[j] < 0) continue;
    bones.push_back((joints[j] - joints[static_cast<std::size_t>(parents[j])]).cast<double>());
  }
  // Sorted by x, a pair closer than the best one so far lies within a window of that width.
  std::sort(bones.begin(), bones.end(), [](const auto& a, const auto& b) { return a.x() < b.x(); });
  double closest = kNoPair;
  for (std::size_t i = 0; i < bones.size(); ++i) {
    for (std::size_t k = i + 1; k < bones.size() && bones[k].x() - bones[i].x() < closest; ++k) {
      closest = std::min(closest, (bones[k] - bones[i]).cwiseAbs().maxCoeff());
    }
  }
  return closest;
}

double outside_share(const std::vector<Eigen::Vector3d>& joints, const Box& box) {
  if (joints.empty()) return 0.0;
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(1e-4 * box.diagonal());
  const Eigen::Vector3d low = box.low - margin, high = box.high + margin;
  const auto outside = std::count_if(joints.begin(), joints.end(), [&](const Eigen::Vector3d& p) {
    return (p.array() < low.array()).any() || (p.array() > high.array()).any();
  });
  return static_cast<double>(outside) / static_cast<double>(joints.size());
}

}  // namespace anigen::prepare
