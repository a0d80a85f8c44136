#include "anigen/prepare/cleaning/joint_rules.h"

#include <vector>

#include "anigen/core/numeric.h"
#include "anigen/prepare/cleaning/joint_removal.h"

namespace anigen::prepare {
namespace {

/// "3 joints merged: b into a, d into c and 1 more"
std::string told(const std::vector<std::string>& each, const std::string& what) {
  constexpr std::size_t kMost = 3;
  std::string text = std::to_string(each.size()) + " joints " + what + ": ";
  for (std::size_t i = 0; i < each.size() && i < kMost; ++i) text += (i == 0 ? "" : ", ") + each[i];
  if (each.size() > kMost) text += " and " + std::to_string(each.size() - kMost) + " more";
  return text;
}

}  // namespace

std::optional<CleaningFinding> merge_duplicate_joints(Asset& asset, double distance) {
  const std::vector<Eigen::Vector3d> positions = asset.skeleton.positions();
  std::vector<int> heir, kept;
  std::vector<std::string> merged;
  for (std::size_t j = 0; j < positions.size(); ++j) {
    heir.push_back(static_cast<int>(j));
    for (const int k : kept) {
      if ((positions[at(k)] - positions[j]).norm() > distance) continue;
      heir[j] = k;
      merged.push_back(asset.skeleton.names[j] + " into " + asset.skeleton.names[at(k)]);
      break;
    }
    if (heir[j] == static_cast<int>(j)) kept.push_back(heir[j]);
  }
  if (merged.empty()) return std::nullopt;
  remove_joints(asset, heir);
  return CleaningFinding{"duplicate_joints", "changed", told(merged, "merged")};
}

std::optional<CleaningFinding> prune_unused_joints(Asset& asset, UnusedJoints which) {
  if (which == UnusedJoints::kKeep) return std::nullopt;
  const std::vector<int>& parents = asset.skeleton.parents;
  std::vector<char> stays = weighted_joints(asset);
  if (which == UnusedJoints::kPruneLeaves) {
    for (std::size_t j = stays.size(); j-- > 1;) {  // children come after their parents
      if (stays[j] != 0) stays[at(parents[j])] = 1;
    }
  }
  std::vector<int> heir(stays.size(), -1);
  std::vector<std::string> pruned;
  for (std::size_t j = 0; j < stays.size(); ++j) {
    if (stays[j] != 0) {
      heir[j] = static_cast<int>(j);
      continue;
    }
    if (parents[j] >= 0) heir[j] = heir[at(parents[j])];
    pruned.push_back(asset.skeleton.names[j]);
  }
  if (pruned.empty()) return std::nullopt;
  remove_joints(asset, heir);
  return CleaningFinding{"unused_joints", "changed", told(pruned, "without weights pruned")};
}

}  // namespace anigen::prepare
