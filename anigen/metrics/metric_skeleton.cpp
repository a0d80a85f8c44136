#include "anigen/metrics/metric_skeleton.h"

#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::metrics {

MetricSkeleton::MetricSkeleton(JointTree tree, const char* name) : JointTree(std::move(tree)) {
  check(*this, name);
  bones = geometry::bones_of(positions, parents);
}

MetricSkeleton MetricSkeleton::graph(std::vector<Eigen::Vector3d> joints,
                                     const std::vector<std::array<int, 2>>& bones) {
  MetricSkeleton result;
  result.positions = std::move(joints);
  for (const auto& [parent, child] : bones) {
    result.bones.push_back({parent, child, result.positions[at(parent)], result.positions[at(child)]});
  }
  if (bones.empty()) result.bones = geometry::bones_of(result.positions, std::vector<int>(result.size(), -1));
  return result;
}

}  // namespace anigen::metrics
