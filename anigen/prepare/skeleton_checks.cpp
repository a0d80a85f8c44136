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

}  // namespace anigen::prepare
