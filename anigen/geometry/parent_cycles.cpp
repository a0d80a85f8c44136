#include "anigen/geometry/parent_cycles.h"

#include <string>

#include "anigen/core/error.h"

namespace anigen::geometry {

std::vector<std::vector<int>> parent_cycles(const std::vector<int>& parents) {
  const auto count = static_cast<int>(parents.size());
  std::vector<int> walk(parents.size(), -1), place(parents.size(), 0);  // which walk has seen a joint, and when
  std::vector<std::vector<int>> cycles;
  std::vector<int> path;
  for (int start = 0; start < count; ++start) {
    path.clear();
    int joint = start;
    while (joint >= 0 && walk[static_cast<std::size_t>(joint)] < 0) {
      const auto at = static_cast<std::size_t>(joint);
      walk[at] = start;
      place[at] = static_cast<int>(path.size());
      path.push_back(joint);
      joint = parents[at] == joint ? -1 : parents[at];
    }
    if (joint >= 0 && walk[static_cast<std::size_t>(joint)] == start) {
      cycles.emplace_back(path.begin() + place[static_cast<std::size_t>(joint)], path.end());
    }
  }
  return cycles;
}

std::vector<int> parents_in_range(const std::vector<int>& parents) {
  std::vector<int> result = parents;
  for (int& parent : result) {
    if (parent < 0 || static_cast<std::size_t>(parent) >= parents.size()) parent = -1;
  }
  return result;
}

std::vector<Eigen::Vector3d> checked_joints(const std::vector<Eigen::Vector3f>& joints) {
  std::vector<Eigen::Vector3d> result;
  result.reserve(joints.size());
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!joints[j].allFinite()) throw InputError("", "joints[" + std::to_string(j) + "]", "not finite");
    result.emplace_back(joints[j].cast<double>());
  }
  return result;
}

}  // namespace anigen::geometry
