#include "anigen/rig/template_skeleton.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/core/progress.h"

namespace anigen::rig {
namespace {

using Points = std::vector<Eigen::Vector3d>;

double mean_nearest_distance(const Points& from, const Points& to) {
  double sum = 0.0;
  for (const Eigen::Vector3d& point : from) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3d& other : to) nearest = std::min(nearest, (point - other).squaredNorm());
    sum += std::sqrt(nearest);
  }
  return sum / static_cast<double>(from.size());
}

double joint_distance(const Points& a, const Points& b) {
  return 0.5 * (mean_nearest_distance(a, b) + mean_nearest_distance(b, a));
}

}  // namespace

BoxedSkeleton boxed_skeleton(const std::string& id, const Points& joints, const std::vector<int>& parents,
                             const Box& box) {
  if (box.empty() || !box.low.allFinite() || !box.high.allFinite()) {
    throw InputError(id, "", "a skeleton is measured by its mesh, and there is none");
  }
  if (joints.empty()) throw InputError(id, "", "there is no joint");
  BoxedSkeleton boxed{id, {}, parents};
  const Eigen::Vector3d extent = box.high - box.low;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!joints[j].allFinite()) throw InputError(id, "joint " + std::to_string(j), "is not finite");
    Eigen::Vector3d place = Eigen::Vector3d::Constant(0.5);
    for (int axis = 0; axis < 3; ++axis) {
      if (extent[axis] > 0.0) place[axis] = (joints[j][axis] - box.low[axis]) / extent[axis];
    }
    boxed.joints.push_back(place);
  }
  return boxed;
}

Points placed_joints(const BoxedSkeleton& skeleton, const Box& box) {
  Points joints;
  for (const Eigen::Vector3d& place : skeleton.joints) {
    joints.push_back(box.low + place.cwiseProduct(box.high - box.low));
  }
  return joints;
}

std::size_t medoid(const std::vector<BoxedSkeleton>& skeletons) {
  if (skeletons.empty()) throw InputError("", "", "the middle of no skeletons");
  // Every distance twice: N² of them would not fit for the data sets that people have.
  std::vector<double> sums(skeletons.size(), 0.0);
  Progress progress("comparing skeletons", skeletons.size(), "skeletons");
  parallel_for(skeletons.size(), [&](std::size_t i) {
    for (const BoxedSkeleton& other : skeletons) sums[i] += joint_distance(skeletons[i].joints, other.joints);
    progress.advance();
  });
  progress.finish();
  return static_cast<std::size_t>(std::min_element(sums.begin(), sums.end()) - sums.begin());
}

}  // namespace anigen::rig
