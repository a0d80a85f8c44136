#include "anigen/eval/skeleton/puppeteer_cleaning.h"

#include <algorithm>
#include <numeric>
#include <set>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::eval {
namespace {

using Bones = std::vector<std::array<int, 2>>;

/// Joint → the joint that stands for it. Sorted by x, since only joints in a slab of that width can be near.
std::vector<int> representatives(const std::vector<Eigen::Vector3d>& joints, int root) {
  const int n = static_cast<int>(joints.size());
  std::vector<int> by_x(joints.size());
  std::iota(by_x.begin(), by_x.end(), 0);
  std::sort(by_x.begin(), by_x.end(), [&](int a, int b) { return joints[at(a)].x() < joints[at(b)].x(); });
  std::vector<int> result(joints.size(), -1);
  for (int i = 0; i < n; ++i) {
    if (result[at(i)] >= 0) continue;
    std::vector<int> group{i};
    const double x = joints[at(i)].x();
    auto candidate = std::lower_bound(by_x.begin(), by_x.end(), x - kPuppeteerMerge,
                                      [&](int j, double bound) { return joints[at(j)].x() < bound; });
    for (; candidate != by_x.end() && joints[at(*candidate)].x() <= x + kPuppeteerMerge; ++candidate) {
      const int j = *candidate;
      if (j > i && result[at(j)] < 0 && (joints[at(i)] - joints[at(j)]).norm() < kPuppeteerMerge) group.push_back(j);
    }
    const bool has_root = std::find(group.begin(), group.end(), root) != group.end();
    for (const int j : group) result[at(j)] = has_root ? root : i;
  }
  return result;
}

/// Renames the ends of bones; drops bones from a joint to itself and repeated ones, keeping the order.
Bones renamed(const Bones& bones, const std::vector<int>& name) {
  Bones result;
  std::set<std::array<int, 2>> seen;
  for (const auto& [parent, child] : bones) {
    const std::array<int, 2> bone{name[at(parent)], name[at(child)]};
    if (bone[0] != bone[1] && seen.insert(bone).second) result.push_back(bone);
  }
  return result;
}

/// Keeps the joints marked, numbered anew in their order.
JointGraph compacted(const JointGraph& graph, const std::vector<char>& keep) {
  JointGraph result;
  std::vector<int> name(graph.joints.size(), -1);
  for (std::size_t j = 0; j < graph.joints.size(); ++j) {
    if (!keep[j]) continue;
    name[j] = static_cast<int>(result.joints.size());
    result.joints.push_back(graph.joints[j]);
  }
  result.bones = renamed(graph.bones, name);
  return result;
}

int find(std::vector<int>& leader, int j) {
  while (leader[at(j)] != j) j = leader[at(j)] = leader[at(leader[at(j)])];
  return j;
}

/// Distances between joints that stay never change, so one pass over all pairs from near to far always meets the
/// nearest pair of two components next.
JointGraph with_components_connected(JointGraph graph) {
  const int n = static_cast<int>(graph.joints.size());
  std::vector<int> component(graph.joints.size());
  std::iota(component.begin(), component.end(), 0);
  for (const auto& [a, b] : graph.bones) component[at(find(component, a))] = find(component, b);
  int components = 0;
  for (int j = 0; j < n; ++j) components += find(component, j) == j;
  if (components <= 1) return graph;
  if (graph.joints.size() > kLargestForest) {
    throw InputError("", "skeleton",
                     "several components of " + std::to_string(n) + " joints together; at most " +
                         std::to_string(kLargestForest) + " can be connected");
  }

  struct Pair {
    double distance;
    int a, b;
  };
  std::vector<Pair> pairs;
  for (int a = 0; a < n; ++a) {
    for (int b = a + 1; b < n; ++b) {
      if (find(component, a) != find(component, b))
        pairs.push_back({(graph.joints[at(a)] - graph.joints[at(b)]).norm(), a, b});
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(), [](const Pair& p, const Pair& q) { return p.distance < q.distance; });
  std::vector<int> name(graph.joints.size());
  std::iota(name.begin(), name.end(), 0);
  std::vector<char> keep(graph.joints.size(), 1);
  for (const Pair& pair : pairs) {
    if (!keep[at(pair.a)] || !keep[at(pair.b)] || find(component, pair.a) == find(component, pair.b)) continue;
    component[at(find(component, pair.b))] = find(component, pair.a);
    if (pair.distance < kPuppeteerConnect) {
      for (int& target : name) {
        if (target == pair.b) target = pair.a;
      }
      keep[at(pair.b)] = 0;
    } else {
      graph.bones.push_back({pair.a, pair.b});
    }
  }
  graph.bones = renamed(graph.bones, name);
  return compacted(graph, keep);
}

}  // namespace

JointGraph puppeteer_cleaned(const io::JointTree& tree) {
  JointGraph graph = joint_graph(tree);
  const int root = roots(tree).front();
  const std::vector<int> name = representatives(graph.joints, root);
  graph.bones = renamed(graph.bones, name);
  std::vector<char> keep(graph.joints.size(), 0);
  if (graph.bones.empty()) {
    for (const int j : name) keep[at(j)] = 1;
    return compacted(graph, keep);
  }
  for (const auto& [parent, child] : graph.bones) keep[at(parent)] = keep[at(child)] = 1;
  keep[at(name[at(root)])] = 1;
  return with_components_connected(compacted(graph, keep));
}

}  // namespace anigen::eval
