#include "anigen/pipeline/rig_bones.h"

#include <cstdint>

#include "anigen/models/anymate/connectivity.h"

namespace anigen::pipeline {

using torch::Tensor;

RigBones bones_between(const Tensor& joints, const std::vector<int>& parents) {
  RigBones found;
  std::vector<std::int64_t> parent;
  for (std::size_t j = 0; j < parents.size(); ++j) {
    parent.push_back(parents[j] < 0 ? static_cast<std::int64_t>(j) : parents[j]);
    if (parents[j] >= 0) found.heads.push_back(parents[j]);
  }
  found.bones = models::anymate::bones_of(joints, torch::tensor(parent, torch::kInt64));
  return found;
}

RigBones bones_of_rig(const Tensor& joints, const std::vector<int>& parents) {
  const auto count = static_cast<std::int64_t>(parents.size());
  Tensor tails = torch::zeros({count, 3});
  std::vector<std::int64_t> children(parents.size(), 0);
  RigBones found;
  for (std::int64_t j = 0; j < count; ++j) {
    found.heads.push_back(static_cast<int>(j));
    const int parent = parents[static_cast<std::size_t>(j)];
    if (parent < 0) continue;
    tails[parent] += joints[j];
    ++children[static_cast<std::size_t>(parent)];
  }
  for (std::int64_t j = 0; j < count; ++j) {
    const std::int64_t own = children[static_cast<std::size_t>(j)];
    const int parent = parents[static_cast<std::size_t>(j)];
    if (own > 0) {
      tails[j] /= static_cast<double>(own);
    } else {
      tails[j] = joints[j];
      if (parent >= 0) tails[j] += 0.5 * (joints[j] - joints[parent]);
    }
  }
  found.bones = torch::cat({joints, tails}, 1);
  return found;
}

}  // namespace anigen::pipeline
