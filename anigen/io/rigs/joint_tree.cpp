#include "anigen/io/rigs/joint_tree.h"

#include "anigen/core/error.h"

namespace anigen::io {

JointTree joint_tree(const Skeleton& skeleton) { return {skeleton.positions(), skeleton.parents}; }

std::vector<int> roots(const JointTree& tree) {
  std::vector<int> result;
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (tree.parents[j] < 0) result.push_back(static_cast<int>(j));
  }
  return result;
}

JointTree connected(JointTree tree) {
  const std::vector<int> all = roots(tree);
  for (std::size_t i = 1; i < all.size(); ++i) tree.parents[static_cast<std::size_t>(all[i])] = all[0];
  return tree;
}

void check(const JointTree& tree, const std::string& file) {
  const std::size_t n = tree.size();
  if (n == 0) throw InputError(file, "", "the skeleton has no joint");
  if (tree.parents.size() != n) {
    throw InputError(file, "", std::to_string(n) + " joints but " + std::to_string(tree.parents.size()) + " parents");
  }
  for (std::size_t j = 0; j < n; ++j) {
    const std::string place = "joint " + std::to_string(j);
    const int parent = tree.parents[j];
    if (!tree.positions[j].allFinite()) throw InputError(file, place, "its position is not finite");
    if (parent < -1 || parent >= static_cast<int>(n))
      throw InputError(file, place, "parent " + std::to_string(parent) + " of " + std::to_string(n) + " joints");
  }
  // A joint whose chain of parents is longer than there are joints hangs on a cycle; marking what is known to end at
  // a root keeps this linear.
  std::vector<char> grounded(n, 0);
  std::vector<std::size_t> chain;
  for (std::size_t start = 0; start < n; ++start) {
    chain.clear();
    int j = static_cast<int>(start);
    while (j >= 0 && !grounded[static_cast<std::size_t>(j)]) {
      chain.push_back(static_cast<std::size_t>(j));
      if (chain.size() > n)
        throw InputError(file, "joint " + std::to_string(start), "is its own ancestor: the skeleton has a cycle");
      j = tree.parents[static_cast<std::size_t>(j)];
    }
    for (const std::size_t k : chain) grounded[k] = 1;
  }
}

}  // namespace anigen::io
