#include <gtest/gtest.h>
#include <algorithm>
#include <limits>
#include <optional>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/prepare/merge.h"
#include "anigen/prepare/metadata.h"

namespace anigen::prepare {

namespace {

struct Tree {
  std::vector<Eigen::Vector3d> joints;
  std::vector<int> parents;
  SkeletonDescriptor descriptor() const { return describe(skeleton_from_joints(joints, parents)); }
};

Tree random_tree(std::size_t joints, Rng& rng) {
  Tree tree;
  for (std::size_t j = 0; j < joints; ++j) {
    tree.joints.emplace_back(rng.uniform(), rng.uniform(), rng.uniform());
    tree.parents.push_back(j == 0 ? -1 : static_cast<int>(rng.index(j)));
  }
  return tree;
}

/// Tree with its joints in another order that has parents first.
Tree reordered(const Tree& tree, Rng& rng) {
  std::vector<int> place(tree.joints.size(), -1), ready = {0};
  Tree result;
  while (!ready.empty()) {
    const std::size_t pick = rng.index(ready.size());
    const int j = ready[pick];
    ready.erase(ready.begin() + static_cast<std::ptrdiff_t>(pick));
    const auto old = static_cast<std::size_t>(j);
    place[old] = static_cast<int>(result.joints.size());
    result.joints.push_back(tree.joints[old]);
    result.parents.push_back(j == 0 ? -1 : place[static_cast<std::size_t>(tree.parents[old])]);
    for (std::size_t k = 0; k < tree.parents.size(); ++k) {
      if (tree.parents[k] == j) ready.push_back(static_cast<int>(k));
    }
  }
  return result;
}

Tree changed(Tree tree, double noise, double scale, const Eigen::Vector3d& shift, Rng& rng) {
  for (Eigen::Vector3d& p : tree.joints) {
    p += noise * Eigen::Vector3d(rng.uniform() - 0.5, rng.uniform() - 0.5, rng.uniform() - 0.5);
    p = scale * p + shift;
  }
  return tree;
}

TEST(SkeletonDescriptor, DoesNotDependOnOrderPlaceOrSize) {
  Rng rng(1, "descriptor");
  for (int trial = 0; trial < 50; ++trial) {
    const Tree tree = random_tree(2 + rng.index(40), rng);
    const SkeletonDescriptor one = tree.descriptor();
    const SkeletonDescriptor other = changed(reordered(tree, rng), 0.0, 3.0, {5, -2, 1}, rng).descriptor();
    EXPECT_EQ(one.topology, other.topology);
    EXPECT_TRUE(near(one, other, 0.002));
    EXPECT_EQ(Json(Json(one).get<SkeletonDescriptor>()), Json(one));
  }
}

TEST(SkeletonDescriptor, TellsTreesApart) {
  const std::vector<Eigen::Vector3d> joints = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}};
  const auto topology = [&](const std::vector<int>& parents) { return Tree{joints, parents}.descriptor().topology; };
  EXPECT_NE(topology({-1, 0, 1, 2, 3}), topology({-1, 0, 1, 2, 2}));
  EXPECT_NE(topology({-1, 0, 0, 1, 2}), topology({-1, 0, 0, 1, 1}));
  EXPECT_EQ(topology({-1, 0, 0, 1, 1}), topology({-1, 0, 0, 2, 2}));
}

TEST(SkeletonDescriptor, DamagedJsonIsRefused) {
  Json json(Tree{{{0, 0, 0}, {1, 0, 0}}, {-1, 0}}.descriptor());
  Json shorter = json, wrong = json;
  shorter["places"] = "1 2 3";
  wrong["depths"] = "0 one";
  EXPECT_THROW(shorter.get<SkeletonDescriptor>(), InputError);
  EXPECT_THROW(wrong.get<SkeletonDescriptor>(), InputError);
}

TEST(NearDuplicates, AgreeWithComparingAllPairs) {
  Rng rng(2, "near duplicates");
  std::vector<SkeletonDescriptor> descriptors;
  std::size_t expected_duplicates = 0;
  for (int kind = 0; kind < 30; ++kind) {
    const Tree tree = random_tree(4 + rng.index(20), rng);
    descriptors.push_back(tree.descriptor());
    for (const double noise : {0.001, 0.2})
      descriptors.push_back(changed(reordered(tree, rng), noise, 1, {0, 0, 0}, rng).descriptor());
    ++expected_duplicates;
  }
  const auto found = near_duplicates(descriptors, 0.01);
  std::size_t duplicates = 0;
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    std::optional<std::size_t> first;
    for (std::size_t k = 0; k < i && !first; ++k) {
      if (!found[k] && near(descriptors[i], descriptors[k], 0.01)) first = k;
    }
    EXPECT_EQ(found[i], first) << i;
    duplicates += found[i] ? 1 : 0;
  }
  EXPECT_GE(duplicates, expected_duplicates) << "small changes are found";
  EXPECT_LT(duplicates, 2 * expected_duplicates) << "large changes are not";
}

TEST(NearDuplicates, SmallSkeletonsAreNotCompared) {
  const SkeletonDescriptor one = Tree{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {-1, 0, 1}}.descriptor();
  EXPECT_FALSE(near_duplicates({one, one})[1].has_value());
  EXPECT_EQ(near_duplicates({one, one}, 0.01, 3)[1], 0u);
  EXPECT_EQ(near_skeletons_of_preset("anymate"), NearSkeletons::kDrop);
  for (const char* other : {"none", "articulation-xl"})
    EXPECT_EQ(near_skeletons_of_preset(other), NearSkeletons::kFlag) << other;
}

}  // namespace

namespace {

std::vector<std::string> numbered(int n) {
  std::vector<std::string> ids;
  for (int i = 0; i < n; ++i) ids.push_back("id-" + std::to_string(i));
  return ids;
}

std::set<std::string> chosen(const std::vector<std::string>& ids, std::size_t count, std::uint64_t seed) {
  const std::vector<bool> test = choose_test(ids, count, seed);
  std::set<std::string> result;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (test[i]) result.insert(ids[i]);
  }
  return result;
}

TEST(Split, HasTheSizeAskedForAndDependsOnTheSeedOnly) {
  std::vector<std::string> ids = numbered(60);
  const auto first = chosen(ids, 20, 5);
  EXPECT_EQ(first.size(), 20u);
  EXPECT_EQ(first, chosen(ids, 20, 5));
  EXPECT_NE(first, chosen(ids, 20, 6));
  std::reverse(ids.begin(), ids.end());
  EXPECT_EQ(first, chosen(ids, 20, 5)) << "the order of the ids must not matter";
  EXPECT_EQ(chosen(ids, 100, 5).size(), 60u);
}

TEST(Split, OneMoreIdMovesAtMostOneOther) {
  std::vector<std::string> ids = numbered(60);
  const auto before = chosen(ids, 20, 5);
  ids.push_back("another");
  const auto after = chosen(ids, 20, 5);
  std::vector<std::string> gone;
  std::set_difference(before.begin(), before.end(), after.begin(), after.end(), std::back_inserter(gone));
  EXPECT_LE(gone.size(), 1u);
}

TEST(Split, FractionIsRoundedAndChecked) {
  EXPECT_EQ(test_count(30, 0.333), 10u);
  EXPECT_EQ(test_count(0, 0.5), 0u);
  EXPECT_EQ(test_count(3, 1.0), 3u);
  for (const double bad : {-0.1, 1.5, std::numeric_limits<double>::quiet_NaN()})
    EXPECT_THROW(test_count(3, bad), InputError) << bad;
}

}  // namespace

}  // namespace anigen::prepare
