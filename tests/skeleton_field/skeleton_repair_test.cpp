#include "anigen/skeleton_field/skeleton_repair.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>

#include "anigen/core/error.h"
#include "anigen/core/random.h"

namespace anigen::skeleton_field {
namespace {

std::vector<Eigen::Vector3f> on_a_line(const std::vector<float>& x) {
  std::vector<Eigen::Vector3f> joints;
  for (const float value : x) joints.emplace_back(value, 0.0F, 0.0F);
  return joints;
}

bool has_a_cycle(const std::vector<int>& parents) {
  for (std::size_t start = 0; start < parents.size(); ++start) {
    int joint = static_cast<int>(start);
    for (std::size_t steps = 0; joint >= 0 && parents[static_cast<std::size_t>(joint)] != joint; ++steps) {
      if (steps > parents.size()) return true;
      joint = parents[static_cast<std::size_t>(joint)];
    }
  }
  return false;
}

/// Guarantees of every result: a permutation, the root first and alone, parents before children.
void expect_rooted(const RootedTree& tree, std::size_t joints) {
  ASSERT_EQ(tree.order.size(), joints);
  ASSERT_EQ(tree.parents.size(), joints);
  std::vector<int> sorted = tree.order, all(joints);
  std::sort(sorted.begin(), sorted.end());
  std::iota(all.begin(), all.end(), 0);
  EXPECT_EQ(sorted, all);
  for (std::size_t j = 0; j < joints; ++j) {
    if (j == 0) {
      EXPECT_EQ(tree.parents[j], -1);
    } else {
      ASSERT_GE(tree.parents[j], 0);
      ASSERT_LT(tree.parents[j], static_cast<int>(j));
    }
  }
}

/// Parents by old index, -1 for the root.
std::vector<int> in_old_order(const RootedTree& tree) {
  std::vector<int> parents(tree.order.size(), -1);
  for (std::size_t j = 1; j < tree.order.size(); ++j)
    parents[static_cast<std::size_t>(tree.order[j])] = tree.order[static_cast<std::size_t>(tree.parents[j])];
  return parents;
}

TEST(SkeletonRepair, LeavesTreesRootsAndSelfParentsAlone) {
  const auto joints = on_a_line({0, 1, 2, 3});
  EXPECT_EQ(repair_parents_as_published(joints, {-1, 0, 1, 2}), (std::vector<int>{-1, 0, 1, 2}));
  EXPECT_EQ(repair_parents_as_published(joints, {0, -1, 2, 2}), (std::vector<int>{0, -1, 2, 2}));
  EXPECT_EQ(repair_parents_as_published(joints, {4, 0, -7, 1000}), (std::vector<int>{-1, 0, -1, -1}));
  EXPECT_TRUE(repair_parents_as_published({}, {}).empty());
}

TEST(SkeletonRepair, CutsACycleAtThePairNearestToTheOutside) {
  // 1 → 2 → 3 → 1 with 0 outside: 3 is nearest to it.
  EXPECT_EQ(repair_parents_as_published(on_a_line({0, 5, 6, 2}), {-1, 2, 3, 1}), (std::vector<int>{-1, 2, 3, 0}));
  // Equally near: the first in the order of the cycle as it is walked, then the first outside.
  EXPECT_EQ(repair_parents_as_published(on_a_line({0, 1, 1, 0}), {-1, 2, 1, -1}), (std::vector<int>{-1, 0, 1, -1}));
}

TEST(SkeletonRepair, OpensACycleThatHoldsEveryJoint) {
  EXPECT_EQ(repair_parents_as_published(on_a_line({0, 1, 2}), {1, 2, 0}), (std::vector<int>{-1, 2, 0}));
}

TEST(SkeletonRepair, WithoutPositionsTheFirstJointOfACycleBecomesARoot) {
  EXPECT_EQ(repair_parents_as_published({}, {3, 2, 1, -1, 1}), (std::vector<int>{3, -1, 1, -1, 1}));
}

// The cuts go 1 → 2, 2 → 3, 1 → 0, 1 → 2, and four rounds are all there are.
TEST(SkeletonRepair, GivesUpLikeThePublishedProgram) {
  const std::vector<int> repaired = repair_parents_as_published(on_a_line({1, 2, 7, 7}), {1, 0, 1, 1});
  EXPECT_EQ(repaired, (std::vector<int>{1, 2, 3, 1}));
  EXPECT_TRUE(has_a_cycle(repaired));
}

// Four joints beside many sound ones: J rounds of the same cuts, whose outcome depends on whether J is odd.
TEST(SkeletonRepair, SkippingPeriodsGivesTheLastRound) {
  for (const int more : {0, 1, 2, 3, 4, 5, 6, 7, 996, 997}) {
    auto joints = on_a_line({1, 2, 7, 7});
    std::vector<int> parents = {1, 0, 1, 1};
    for (int j = 0; j < more; ++j) {
      joints.emplace_back(1e6F, static_cast<float>(j), 0.0F);
      parents.push_back(j == 0 ? -1 : 3 + j);
    }
    // After two rounds 2 hangs on 3; from then on joint 1 alternates between 0 and 2.
    const int rounds = std::max(4, 4 + more);
    EXPECT_EQ(repair_parents_as_published(joints, parents)[1], rounds % 2 == 1 ? 0 : 2) << more;
  }
}

TEST(SkeletonRepair, HopsGoUpAndDownTheTree) {
  const auto hops = hop_distances({-1, 0, 1, 0, -1, 99});
  EXPECT_EQ(hops[2], (std::vector<int>{2, 1, 0, 3, kUnreachableHops, kUnreachableHops}));
  EXPECT_EQ(hops[4], (std::vector<int>{kUnreachableHops, kUnreachableHops, kUnreachableHops, kUnreachableHops, 0,
                                       kUnreachableHops}));
  // A cycle of five is walked the shorter way round; a joint that is its own parent has no neighbour above.
  EXPECT_EQ(hop_distances({1, 2, 3, 4, 0})[0], (std::vector<int>{0, 1, 2, 2, 1}));
  EXPECT_EQ(hop_distances({0, 0})[1], (std::vector<int>{1, 0}));
  EXPECT_TRUE(hop_distances({}).empty());
}

TEST(OneRootedTree, KeepsASoundTreeAsItIs) {
  const std::vector<int> parents = {-1, 0, 0, 1, 2, 1};
  const RootedTree tree = one_rooted_tree(on_a_line({0, 1, 2, 3, 4, 5}), parents);
  EXPECT_EQ(tree.order, (std::vector<int>{0, 1, 2, 3, 4, 5}));
  EXPECT_EQ(tree.parents, parents);
}

TEST(OneRootedTree, PutsParentsFirst) {
  // The root is joint 3, 0 hangs on 2.
  const RootedTree tree = one_rooted_tree(on_a_line({0, 1, 2, 3}), {2, 3, 1, -1});
  EXPECT_EQ(tree.order, (std::vector<int>{3, 1, 2, 0}));
  EXPECT_EQ(tree.parents, (std::vector<int>{-1, 0, 1, 2}));
}

TEST(OneRootedTree, JoinsAForestAtTheNearestJointOutsideTheSubtree) {
  // Trees {0, 1}, {2, 3, 4} and {5}: the second is the largest. 0 goes to 5 (x = 0.4), the nearest that is not below
  // it; then 5, on which 0 and 1 hang now, to 4 (x = 2).
  const RootedTree tree = one_rooted_tree(on_a_line({0, 0.5F, 9, 8, 2, 0.4F}), {-1, 0, -1, 2, 3, -1});
  expect_rooted(tree, 6);
  EXPECT_EQ(in_old_order(tree), (std::vector<int>{5, 0, -1, 2, 3, 4}));
}

TEST(OneRootedTree, OpensCyclesSelfParentsAndParentsOutOfRange) {
  const RootedTree cycle = one_rooted_tree(on_a_line({0, 1, 2}), {1, 2, 0});
  expect_rooted(cycle, 3);
  EXPECT_EQ(cycle.order[0], 0);
  const RootedTree self = one_rooted_tree(on_a_line({0, 1, 2}), {0, 1, 1});
  expect_rooted(self, 3);
  EXPECT_EQ(in_old_order(self), (std::vector<int>{1, -1, 1}));
  const RootedTree range = one_rooted_tree(on_a_line({0, 1, 2}), {7, -9, 3});
  expect_rooted(range, 3);
  EXPECT_EQ(in_old_order(range), (std::vector<int>{-1, 0, 1}));
  // A cycle 1 → 2 → 3 → 1 beside a tree of four: it is opened at 3, which then hangs on 0.
  const RootedTree beside = one_rooted_tree(on_a_line({0, 5, 6, 2, 0, 0, 0}), {-1, 2, 3, 1, 0, 0, 0});
  expect_rooted(beside, 7);
  EXPECT_EQ(in_old_order(beside), (std::vector<int>{-1, 2, 3, 0, 0, 0, 0}));
}

TEST(OneRootedTree, AJointAloneAndNone) {
  expect_rooted(one_rooted_tree(on_a_line({3}), {0}), 1);
  EXPECT_TRUE(one_rooted_tree({}, {}).order.empty());
}

TEST(OneRootedTree, EveryGraphBecomesATree) {
  Rng rng(1, "graphs");
  for (int graph = 0; graph < 400; ++graph) {
    const std::size_t count = 1 + rng.index(12);
    std::vector<Eigen::Vector3f> joints;
    std::vector<int> parents;
    for (std::size_t j = 0; j < count; ++j) {
      joints.emplace_back(static_cast<float>(rng.index(4)), static_cast<float>(rng.index(4)), 0.0F);
      parents.push_back(static_cast<int>(rng.index(count + 2)) - 1);
    }
    expect_rooted(one_rooted_tree(joints, parents), count);
    expect_rooted(one_rooted_tree(joints, repair_parents_as_published(joints, parents)), count);
  }
}

TEST(OneRootedTree, LongChainsInAnyOrder) {
  const int count = 100000;
  std::vector<Eigen::Vector3f> joints(count, Eigen::Vector3f::Zero());
  std::vector<int> forward(count), backward(count), closed(count);
  for (int j = 0; j < count; ++j) {
    const auto at = static_cast<std::size_t>(j);
    joints[at].x() = static_cast<float>(j);
    forward[at] = j - 1;
    backward[at] = j + 1 < count ? j + 1 : -1;
    closed[at] = (j + 1) % count;
  }
  EXPECT_EQ(one_rooted_tree(joints, forward).parents, forward);
  const RootedTree reversed = one_rooted_tree(joints, backward);
  EXPECT_EQ(reversed.order.front(), count - 1);
  EXPECT_EQ(reversed.parents, forward);
  expect_rooted(one_rooted_tree(joints, closed), joints.size());
  EXPECT_EQ(repair_parents_as_published(joints, forward), forward);
}

TEST(SkeletonRepair, RefusesBadInput) {
  const auto joints = on_a_line({0, 1, std::numeric_limits<float>::quiet_NaN()});
  EXPECT_THROW(repair_parents_as_published(joints, {-1, 0, 1}), InputError);
  EXPECT_THROW(one_rooted_tree(joints, {-1, 0, 1}), InputError);
  EXPECT_THROW(repair_parents_as_published(on_a_line({0, 1}), {-1}), InputError);
  EXPECT_THROW(one_rooted_tree(on_a_line({0, 1}), {-1}), InputError);
  EXPECT_THROW(one_rooted_tree({}, {-1}), InputError);
}

}  // namespace
}  // namespace anigen::skeleton_field
