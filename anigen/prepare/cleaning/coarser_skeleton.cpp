#include "anigen/prepare/cleaning/coarser_skeleton.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/prepare/cleaning/joint_removal.h"

namespace anigen::prepare {

std::vector<int> coarser_heirs(const Skeleton& skeleton, const std::vector<char>& weighted, std::size_t wanted) {
  const std::vector<Eigen::Vector3d> positions = skeleton.positions();
  std::vector<int> heir(skeleton.size());
  for (std::size_t j = 0; j < heir.size(); ++j) heir[j] = static_cast<int>(j);
  // Parents come before children, so that one pass passes everything on to what still stays.
  const auto heir_of_parent = [&](std::size_t j) { return heir[at(skeleton.parents[j])]; };
  for (std::size_t left = heir.size(); left > std::max<std::size_t>(wanted, 1); --left) {
    std::size_t least = 0;
    std::tuple<char, double> least_worth{2, 0.0};
    for (std::size_t j = 0; j < heir.size(); ++j) {
      if (heir[j] != static_cast<int>(j) || skeleton.parents[j] < 0) continue;
      const double bone = (positions[j] - positions[at(heir_of_parent(j))]).norm();
      const std::tuple<char, double> worth{weighted[j], bone};
      if (worth < least_worth) std::tie(least, least_worth) = std::make_tuple(j, worth);
    }
    if (std::get<0>(least_worth) == 2) break;  // only roots are left
    for (std::size_t j = least; j < heir.size(); ++j) {
      if (j == least || heir[j] != static_cast<int>(j)) heir[j] = heir_of_parent(j);
    }
  }
  return heir;
}

std::optional<CleaningFinding> coarsen_skeleton(Asset& asset, const ShareRange& share, const std::string& name) {
  constexpr double kFewest = 2.0;
  const std::size_t joints = asset.skeleton.size();
  const double drawn = Rng(0, "share of joints kept of " + name).uniform(share.least, share.most);
  const auto wanted = static_cast<std::size_t>(std::max(kFewest, std::round(drawn * static_cast<double>(joints))));
  if (wanted >= joints) return std::nullopt;
  remove_joints(asset, coarser_heirs(asset.skeleton, weighted_joints(asset), wanted));
  return CleaningFinding{"kept_joints", "changed",
                         std::to_string(asset.skeleton.size()) + " of " + std::to_string(joints) + " joints kept"};
}

}  // namespace anigen::prepare
