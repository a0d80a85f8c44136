#include <functional>
#include <limits>
#include <numeric>
#include <queue>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/geometry/parent_cycles.h"
#include "anigen/geometry/skeleton_repair.h"

namespace anigen::geometry {
namespace {

using Positions = std::vector<Eigen::Vector3d>;

/// Joints that hang together, by union-find with sizes.
class JointParts {
 public:
  explicit JointParts(const std::vector<int>& parents) : leaders_(parents.size()), sizes_(parents.size(), 1) {
    std::iota(leaders_.begin(), leaders_.end(), std::size_t{0});
    for (std::size_t j = 0; j < parents.size(); ++j) {
      if (parents[j] >= 0) join(j, static_cast<std::size_t>(parents[j]));
    }
  }

  /// The same for all joints of a part.
  std::size_t of(std::size_t joint) {
    while (leaders_[joint] != joint) {
      leaders_[joint] = leaders_[leaders_[joint]];
      joint = leaders_[joint];
    }
    return joint;
  }
  std::size_t size_of(std::size_t joint) { return sizes_[of(joint)]; }

  void join(std::size_t a, std::size_t b) {
    a = of(a);
    b = of(b);
    if (a == b) return;
    if (sizes_[a] < sizes_[b]) std::swap(a, b);
    leaders_[b] = a;
    sizes_[a] += sizes_[b];
  }

 private:
  std::vector<std::size_t> leaders_, sizes_;
};

/// The joint of a cycle that is nearest to a joint of another part; the first of the cycle when there is no other.
int opening_of(const std::vector<int>& cycle, const Positions& joints, JointParts& parts) {
  const std::size_t part = parts.of(static_cast<std::size_t>(cycle.front()));
  Positions inside, outside;
  for (const int joint : cycle) inside.push_back(joints[static_cast<std::size_t>(joint)]);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (parts.of(j) != part) outside.push_back(joints[j]);
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
void join_roots(const Positions& joints, JointParts& parts, std::vector<int>& parents) {
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
    const std::size_t own = parts.of(root);
    std::size_t best = largest;
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < joints.size(); ++j) {
      const double squared = (joints[j] - joints[root]).squaredNorm();
      if (squared >= nearest || parts.of(j) == own) continue;
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
  JointParts parts(connected);
  for (const std::vector<int>& cycle : parent_cycles(connected)) {
    connected[static_cast<std::size_t>(opening_of(cycle, positions, parts))] = -1;
  }
  join_roots(positions, parts, connected);
  return parents_first(connected);
}

}  // namespace anigen::geometry
