#include "anigen/loaders/balanced_groups.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/random.h"

namespace anigen::loaders {
namespace {

using Groups = std::vector<std::vector<std::size_t>>;

TEST(BalancedGroups, HeaviestFirstToTheLightest) {
  EXPECT_EQ(balanced_groups({4, 9, 7, 1, 5}, 2), (Groups{{1, 0}, {2, 4, 3}}));
  EXPECT_EQ(balanced_groups({3, 2}, 1), (Groups{{0, 1}}));
  EXPECT_EQ(balanced_groups({2, 3}, 3), (Groups{{1}, {0}, {}}));
}

TEST(BalancedGroups, EqualSizeFillsUp) {
  // Without the limit all the small ones would go to the second group.
  EXPECT_EQ(balanced_groups({100, 1, 2, 3}, 2), (Groups{{0}, {3, 2, 1}}));
  EXPECT_EQ(balanced_groups({100, 1, 2, 3}, 2, true), (Groups{{0, 1}, {3, 2}}));
  EXPECT_THROW(balanced_groups({1, 2, 3}, 2, true), InputError);
  EXPECT_THROW(balanced_groups({1}, 0), InputError);
}

// A group that gets an item is the lightest then, so at most the mean: it ends no more than one item above it.
TEST(BalancedGroups, StaysWithinTheBound) {
  Rng rng(2, "t");
  for (int round = 0; round < 50; ++round) {
    std::vector<std::uint64_t> loads(24);
    std::uint64_t sum = 0, largest = 0;
    for (std::uint64_t& load : loads) {
      load = 1 + rng.index(30000);
      sum += load;
      largest = std::max(largest, load);
    }
    std::size_t items = 0;
    for (const auto& group : balanced_groups(loads, 4)) {
      std::uint64_t total = 0;
      for (const std::size_t i : group) total += loads[i];
      EXPECT_LE(total, sum / 4 + largest);
      items += group.size();
    }
    EXPECT_EQ(items, loads.size());
  }
}

}  // namespace
}  // namespace anigen::loaders
