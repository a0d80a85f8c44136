#include "anigen/skeleton_field/skeleton_repair.h"

#include <algorithm>
#include <functional>
#include <limits>
#include <queue>
#include <string>
#include <utility>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/error.h"
#include "anigen/skeleton_field/field.h"

namespace anigen::skeleton_field {

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
    if (joint >= 0 && walk[static_cast<std::size_t>(joint)] == start)
      cycles.emplace_back(path.begin() + place[static_cast<std::size_t>(joint)], path.end());
  }
  return cycles;
}

namespace {

std::vector<int> parents_in_range(const std::vector<int>& parents) {
  std::vector<int> result = parents;
  for (int& parent : result) {
    if (parent < 0 || static_cast<std::size_t>(parent) >= parents.size()) parent = -1;
  }
  return result;
}

// In double, the precision in which distances between joints are compared.
std::vector<Eigen::Vector3d> checked_joints(const std::vector<Eigen::Vector3f>& joints) {
  std::vector<Eigen::Vector3d> result;
  result.reserve(joints.size());
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!joints[j].allFinite()) throw InputError("", "joints[" + std::to_string(j) + "]", "not finite");
    result.emplace_back(joints[j].cast<double>());
  }
  return result;
}

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

using Positions = std::vector<Eigen::Vector3d>;

/// Joints that hang together.
DisjointSets joint_parts(const std::vector<int>& parents) {
  DisjointSets parts(parents.size());
  for (std::size_t j = 0; j < parents.size(); ++j) {
    if (parents[j] >= 0) parts.join(j, static_cast<std::size_t>(parents[j]));
  }
  return parts;
}

/// The joint of a cycle that is nearest to a joint of another part; the first of the cycle when there is no other.
int opening_of(const std::vector<int>& cycle, const Positions& joints, DisjointSets& parts) {
  const std::size_t part = parts.find(static_cast<std::size_t>(cycle.front()));
  Positions inside, outside;
  for (const int joint : cycle) inside.push_back(joints[static_cast<std::size_t>(joint)]);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (parts.find(j) != part) outside.push_back(joints[j]);
  }
  if (outside.empty()) return cycle.front();
  const std::vector<NearestJoints> nearest = nearest_joints(inside, outside);
  std::size_t best = 0;
  for (std::size_t i = 1; i < nearest.size(); ++i) {
    if (nearest[i].first < nearest[best].first) best = i;
  }
  return cycle[best];
}

/// @pre no cycles. Leaves one root.
void join_roots(const Positions& joints, DisjointSets& parts, std::vector<int>& parents) {
  std::vector<std::size_t> roots;
  for (std::size_t j = 0; j < parents.size(); ++j) {
    if (parents[j] < 0) roots.push_back(j);
  }
  std::size_t largest = roots.front();
  for (const std::size_t root : roots) {
    if (parts.size_of(root) > parts.size_of(largest)) largest = root;
  }
  for (const std::size_t root : roots) {
    if (root == largest) continue;
    const std::size_t own = parts.find(root);
    std::size_t best = largest;
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < joints.size(); ++j) {
      const double squared = (joints[j] - joints[root]).squaredNorm();
      if (squared >= nearest || parts.find(j) == own) continue;
      nearest = squared;
      best = j;
    }
    parents[root] = static_cast<int>(best);
    parts.join(root, best);
  }
}

/// Parents before children, otherwise by index. @pre one root, no cycle
RootedTree parents_first(const std::vector<int>& parents) {
  const std::size_t count = parents.size();
  std::vector<std::vector<int>> children(count);
  std::priority_queue<int, std::vector<int>, std::greater<int>> ready;
  for (std::size_t j = 0; j < count; ++j) {
    if (parents[j] < 0) {
      ready.push(static_cast<int>(j));
    } else {
      children[static_cast<std::size_t>(parents[j])].push_back(static_cast<int>(j));
    }
  }
  RootedTree tree;
  std::vector<int> place(count, -1);
  while (!ready.empty()) {
    const int joint = ready.top();
    ready.pop();
    const auto j = static_cast<std::size_t>(joint);
    place[j] = static_cast<int>(tree.order.size());
    tree.order.push_back(joint);
    tree.parents.push_back(parents[j] < 0 ? -1 : place[static_cast<std::size_t>(parents[j])]);
    for (const int child : children[j]) ready.push(child);
  }
  return tree;
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

RootedTree one_rooted_tree(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents) {
  if (joints.size() != parents.size()) {
    throw InputError("", "parents",
                     std::to_string(joints.size()) + " joints but " + std::to_string(parents.size()) + " parents");
  }
  if (joints.empty()) return {};
  const Positions positions = checked_joints(joints);
  std::vector<int> connected = parents_in_range(parents);
  for (std::size_t j = 0; j < connected.size(); ++j) {
    if (connected[j] == static_cast<int>(j)) connected[j] = -1;
  }
  DisjointSets parts = joint_parts(connected);
  for (const std::vector<int>& cycle : parent_cycles(connected))
    connected[static_cast<std::size_t>(opening_of(cycle, positions, parts))] = -1;
  join_roots(positions, parts, connected);
  return parents_first(connected);
}

}  // namespace anigen::skeleton_field
