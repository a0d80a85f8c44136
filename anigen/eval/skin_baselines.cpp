#include "anigen/eval/skin_baselines.h"

#include <algorithm>
#include <cmath>

#include "anigen/geometry/bone_segments.h"

namespace anigen::eval {

std::vector<float> nearest_bone_weights(const GroundTruth& truth) {
  const auto segments = geometry::bone_segments(truth.joints, truth.parents);
  const std::vector<std::size_t> nearest = geometry::nearest_moving_joints(truth.vertices, segments);
  std::vector<float> weights(truth.vertex_count() * truth.joint_count(), 0.0f);
  for (std::size_t v = 0; v < nearest.size(); ++v) weights[v * truth.joint_count() + nearest[v]] = 1.0f;
  return weights;
}

std::vector<float> inverse_distance_weights(const GroundTruth& truth, double power) {
  const auto segments = geometry::bone_segments(truth.joints, truth.parents);
  const std::size_t joints = truth.joint_count();
  std::vector<float> weights(truth.vertex_count() * joints);
  std::vector<double> row(joints);
  for (std::size_t v = 0; v < truth.vertex_count(); ++v) {
    double nearest = 1e300, sum = 0;
    for (std::size_t j = 0; j < joints; ++j) {
      row[j] = geometry::distance(truth.vertices[v], segments[j]) + 1e-6;
      nearest = std::min(nearest, row[j]);
    }
    // Relative to the nearest bone, no power overflows.
    for (double& w : row) sum += w = std::pow(nearest / w, power);
    for (std::size_t j = 0; j < joints; ++j) weights[v * joints + j] = static_cast<float>(row[j] / sum);
  }
  return weights;
}

std::vector<float> strongest_joint_weights(const GroundTruth& truth) {
  const std::size_t joints = truth.joint_count();
  std::vector<float> weights(truth.skin.size(), 0.0f);
  for (std::size_t v = 0; v < truth.vertex_count(); ++v) {
    const auto row = truth.skin.begin() + static_cast<std::ptrdiff_t>(v * joints);
    weights[v * joints +
            static_cast<std::size_t>(std::max_element(row, row + static_cast<std::ptrdiff_t>(joints)) - row)] = 1.0f;
  }
  return weights;
}

std::vector<SkinMethod> skin_baselines() {
  const auto geometric = [](const std::string& key, const std::string& label, auto function) {
    return SkinMethod{key, label,
                      [function](const io::DatasetItem&, const GroundTruth& truth) { return function(truth); }};
  };
  std::vector<SkinMethod> methods = {
      geometric("nearest_bone", "nearest bone", nearest_bone_weights),
      geometric("inverse_distance", "inverse distance, power 8",
                [](const GroundTruth& t) { return inverse_distance_weights(t); }),
      geometric("strongest_joint", "strongest true joint (oracle)", strongest_joint_weights),
      geometric("rank4", "best rank 4 (oracle)", [](const GroundTruth& t) { return low_rank_weights(t); }),
      geometric("mixture4", "mixture of 4 rows (oracle)", [](const GroundTruth& t) { return mixture_weights(t); })};
  for (std::size_t i = 2; i < methods.size(); ++i) methods[i].oracle = true;
  return methods;
}

}  // namespace anigen::eval
