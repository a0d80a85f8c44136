#include "anigen/geometry/skeleton_repair.h"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/geometry/parent_cycles.h"

namespace anigen::geometry {
namespace {

/// A joint of a cycle and the joint outside it that it goes to; -1 when there is none.
struct CycleCut {
  int joint = -1, parent = -1;
};

/// The nearest pair; of equally near ones the first in the order of the cycle, then of joints.
CycleCut nearest_cut(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& cycle) {
  std::vector<char> is_inside(joints.size(), 0);
  for (const int joint : cycle) is_inside[static_cast<std::size_t>(joint)] = 1;
  CycleCut cut{cycle.front(), -1};
  double nearest = std::numeric_limits<double>::infinity();
  for (const int joint : cycle) {
    for (std::size_t other = 0; other < joints.size(); ++other) {
      if (is_inside[other] != 0) continue;
      const double squared = (joints[static_cast<std::size_t>(joint)] - joints[other]).squaredNorm();
      if (squared >= nearest) continue;
      nearest = squared;
      cut = {joint, static_cast<int>(other)};
    }
  }
  return cut;
}

/// Cuts the cycles there are at the beginning of a round. @return false when there were none
bool cut_cycles(const std::vector<Eigen::Vector3d>& joints, std::vector<int>& parents) {
  const std::vector<std::vector<int>> cycles = parent_cycles(parents);
  for (const std::vector<int>& cycle : cycles) {
    const CycleCut cut = joints.empty() ? CycleCut{cycle.front(), -1} : nearest_cut(joints, cycle);
    parents[static_cast<std::size_t>(cut.joint)] = cut.parent;
  }
  return !cycles.empty();
}

}  // namespace

std::vector<int> repair_parents_as_published(const std::vector<Eigen::Vector3f>& joints,
                                             const std::vector<int>& parents) {
  if (!joints.empty() && joints.size() != parents.size()) {
    throw InputError("", "parents",
                     std::to_string(joints.size()) + " joints but " + std::to_string(parents.size()) + " parents");
  }
  const std::vector<Eigen::Vector3d> positions = checked_joints(joints);
  std::vector<int> repaired = parents_in_range(parents);
  // Cuts that undo each other come back to the same parents every few rounds: once they do, whole periods are skipped,
  // which gives the result of the last round without going through all. Parents are compared with those of one earlier
  // round, at distances that double (Brent's cycle detection).
  std::size_t rounds = std::max<std::size_t>(4, parents.size());
  std::vector<int> earlier = repaired;
  std::size_t since = 0, next_snapshot = 1;
  bool is_periodic = false;
  while (rounds > 0 && cut_cycles(positions, repaired)) {
    --rounds;
    if (is_periodic) continue;
    ++since;
    if (repaired == earlier) {
      rounds %= since;
      is_periodic = true;
    } else if (since == next_snapshot) {
      earlier = repaired;
      next_snapshot *= 2;
      since = 0;
    }
  }
  return repaired;
}

std::vector<std::vector<int>> hop_distances(const std::vector<int>& parents) {
  const std::size_t count = parents.size();
  const std::vector<int> up = parents_in_range(parents);
  std::vector<std::vector<int>> neighbours(count);
  for (std::size_t j = 0; j < count; ++j) {
    if (up[j] < 0 || up[j] == static_cast<int>(j)) continue;
    neighbours[j].push_back(up[j]);
    neighbours[static_cast<std::size_t>(up[j])].push_back(static_cast<int>(j));
  }
  std::vector<std::vector<int>> hops(count, std::vector<int>(count, kUnreachableHops));
  std::vector<int> queue;
  for (std::size_t from = 0; from < count; ++from) {
    std::vector<int>& row = hops[from];
    row[from] = 0;
    queue.assign(1, static_cast<int>(from));
    for (std::size_t next = 0; next < queue.size(); ++next) {
      const auto joint = static_cast<std::size_t>(queue[next]);
      for (const int other : neighbours[joint]) {
        if (row[static_cast<std::size_t>(other)] != kUnreachableHops) continue;
        row[static_cast<std::size_t>(other)] = row[joint] + 1;
        queue.push_back(other);
      }
    }
  }
  return hops;
}

}  // namespace anigen::geometry
