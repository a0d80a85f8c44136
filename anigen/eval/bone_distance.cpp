#include "anigen/eval/bone_distance.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace anigen::eval {

std::vector<std::vector<BoneSegment>> bone_segments(const std::vector<Eigen::Vector3f>& joints,
                                                    const std::vector<int>& parents) {
  std::vector<std::vector<BoneSegment>> segments(joints.size());
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (parents[j] >= 0) {
      const auto parent = static_cast<std::size_t>(parents[j]);
      segments[parent].push_back({joints[parent], joints[j]});
    }
  }
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!segments[j].empty()) continue;
    const Eigen::Vector3f from = parents[j] >= 0 ? joints[static_cast<std::size_t>(parents[j])] : joints[j];
    segments[j].push_back({joints[j], joints[j] + 0.5f * (joints[j] - from)});
  }
  return segments;
}

float distance(const Eigen::Vector3f& point, const std::vector<BoneSegment>& segments) {
  float nearest = std::numeric_limits<float>::infinity();
  for (const BoneSegment& segment : segments) {
    const Eigen::Vector3f along = segment.end - segment.start;
    const float length2 = along.squaredNorm();
    const float t = length2 > 0.0f ? std::clamp((point - segment.start).dot(along) / length2, 0.0f, 1.0f) : 0.0f;
    nearest = std::min(nearest, (point - segment.start - t * along).squaredNorm());
  }
  return std::sqrt(nearest);
}

}  // namespace anigen::eval
