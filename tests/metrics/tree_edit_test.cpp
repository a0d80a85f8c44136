#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <numeric>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/metrics/tree_edit.h"

namespace anigen::metrics {
namespace {

JointTree tree_of(std::vector<int> parents) {
  JointTree tree;
  tree.positions.assign(parents.size(), Eigen::Vector3d::Zero());
  tree.parents = std::move(parents);
  return tree;
}

int by_index(const std::vector<int>& a, const std::vector<int>& b) {
  return tree_edit_distance(tree_of(a), tree_of(b), ChildOrder::kIndex).value();
}
int canonical(const std::vector<int>& a, const std::vector<int>& b) {
  return tree_edit_distance(tree_of(a), tree_of(b), ChildOrder::kCanonical).value();
}

/// A forest as nested lists, and the distance by its recursive definition.
struct Node {
  std::vector<Node> children;
};
using Forest = std::vector<Node>;

Forest forest_of(const std::vector<int>& parents, int parent) {
  Forest forest;
  for (std::size_t j = 0; j < parents.size(); ++j) {
    if (parents[j] == parent) forest.push_back({forest_of(parents, static_cast<int>(j))});
  }
  return forest;
}

std::string text(const Forest& forest) {
  std::string result;
  for (const Node& node : forest) result += "(" + text(node.children) + ")";
  return result;
}

Forest without_last(Forest forest) {  // deleting a node leaves its children in its place
  const Forest children = forest.back().children;
  forest.pop_back();
  forest.insert(forest.end(), children.begin(), children.end());
  return forest;
}

int slow(const Forest& a, const Forest& b, std::map<std::string, int>& known) {
  const std::string key = text(a) + "|" + text(b);
  const auto found = known.find(key);
  if (found != known.end()) return found->second;
  int result = 0;
  if (a.empty() && b.empty()) {
    result = 0;
  } else if (a.empty()) {
    result = 1 + slow(a, without_last(b), known);
  } else if (b.empty()) {
    result = 1 + slow(without_last(a), b, known);
  } else {
    result = 1 + std::min(slow(without_last(a), b, known), slow(a, without_last(b), known));
    const Forest rest_a(a.begin(), a.end() - 1), rest_b(b.begin(), b.end() - 1);
    result = std::min(result, slow(a.back().children, b.back().children, known) + slow(rest_a, rest_b, known));
  }
  return known[key] = result;
}

std::vector<int> random_parents(Rng& rng, std::size_t joints, bool forest) {
  std::vector<int> parents(joints, -1);
  for (std::size_t j = 1; j < joints; ++j) {
    if (!forest || rng.uniform() < 0.8) parents[j] = static_cast<int>(rng.index(j));
  }
  return parents;
}

std::vector<int> relabelled(const std::vector<int>& parents, Rng& rng) {
  const std::vector<std::size_t> name = rng.permutation(parents.size());
  std::vector<int> result(parents.size());
  for (std::size_t j = 0; j < parents.size(); ++j)
    result[name[j]] = parents[j] < 0 ? -1 : static_cast<int>(name[static_cast<std::size_t>(parents[j])]);
  return result;
}

TEST(TreeEditDistance, AgreesWithHandComputedNumbers) {
  EXPECT_EQ(by_index({-1}, {-1}), 0);
  EXPECT_EQ(by_index({-1}, {-1, 0, 1}), 2);           // a chain of three: two insertions
  EXPECT_EQ(by_index({-1, 0, 1}, {-1, 0, 0}), 2);     // chain against fork: one joint out, one in
  EXPECT_EQ(by_index({-1, 0, 1}, {-1, 0, 1, 2}), 1);  // a joint inserted in a bone
  EXPECT_EQ(by_index({-1, -1}, {-1, 0}), 2);          // two roots against a bone
}

TEST(TreeEditDistance, AgreesWithItsRecursiveDefinition) {
  for (std::uint64_t trial = 0; trial < 150; ++trial) {
    Rng rng(trial, "tree_edit_test");
    const std::vector<int> a = random_parents(rng, 1 + rng.index(8), trial % 3 == 0);
    const std::vector<int> b = random_parents(rng, 1 + rng.index(8), trial % 3 == 0);
    std::map<std::string, int> known;
    EXPECT_EQ(by_index(a, b), slow(forest_of(a, -1), forest_of(b, -1), known)) << "trial " << trial;
  }
}

TEST(TreeEditDistance, DependsOnChildOrderOnlyByIndex) {
  // A root with a tip and a chain of two, in both orders.
  const std::vector<int> tip_first = {-1, 0, 0, 2}, chain_first = {-1, 0, 1, 0};
  EXPECT_EQ(by_index(tip_first, chain_first), 2);
  EXPECT_EQ(canonical(tip_first, chain_first), 0);
}

TEST(TreeEditDistance, InCanonicalOrderIgnoresNumbering) {
  for (std::uint64_t trial = 0; trial < 50; ++trial) {
    Rng rng(trial, "tree_edit_relabel");
    const std::vector<int> a = random_parents(rng, 40, trial % 4 == 0), b = random_parents(rng, 30, false);
    EXPECT_EQ(canonical(a, relabelled(a, rng)), 0);
    EXPECT_EQ(canonical(a, b), canonical(relabelled(a, rng), relabelled(b, rng)));
    EXPECT_EQ(canonical(a, b), canonical(b, a));
    EXPECT_GE(canonical(a, b), 10);  // at least the difference in size
  }
}

TEST(TreeEditDistance, HandlesDeepTreesAndGivesUpOnHugeOnes) {
  std::vector<int> chain(3000), comb(3001, 0);
  std::iota(chain.begin(), chain.end(), -1);
  EXPECT_EQ(by_index(chain, std::vector<int>(chain.begin(), chain.end() - 7)), 7);
  std::vector<int> huge(200000);
  std::iota(huge.begin(), huge.end(), -1);
  EXPECT_FALSE(tree_edit_distance(tree_of(huge), tree_of(huge)).has_value());
  // A comb whose teeth come before the rest of its spine is a lot of work one way round, and little the other.
  comb[0] = -1;
  for (int j = 1; j <= 3000; ++j) comb[static_cast<std::size_t>(j)] = j % 2 == 1 ? std::max(0, j - 1) : j - 2;
  EXPECT_EQ(by_index(comb, comb), 0);
  EXPECT_THROW(tree_edit_distance(tree_of({}), tree_of({-1})), InputError);
}

}  // namespace
}  // namespace anigen::metrics
