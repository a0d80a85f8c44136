#include "anigen/core/disjoint_sets.h"

#include <gtest/gtest.h>

namespace anigen {
namespace {

TEST(DisjointSets, JoinWhatHangsTogether) {
  DisjointSets sets(6);
  EXPECT_TRUE(sets.join(3, 1));
  EXPECT_TRUE(sets.join(1, 5));
  EXPECT_FALSE(sets.join(5, 3));
  EXPECT_TRUE(sets.same(1, 5));
  EXPECT_FALSE(sets.same(0, 5));
  EXPECT_EQ(sets.find(5), 3u) << "the first one's representative stays";
  EXPECT_EQ(sets.size_of(5), 3u);
  EXPECT_EQ(sets.size_of(0), 1u);
}

TEST(DisjointSets, AreRepresentedByTheirLowestMemberWhereAsked) {
  DisjointSets sets(5);
  EXPECT_TRUE(sets.join_lowest(4, 2));
  EXPECT_TRUE(sets.join_lowest(2, 3));
  EXPECT_FALSE(sets.join_lowest(3, 4));
  for (const std::size_t i : {2u, 3u, 4u}) EXPECT_EQ(sets.find(i), 2u);
  EXPECT_TRUE(sets.join_lowest(4, 0));
  EXPECT_EQ(sets.find(3), 0u);
}

}  // namespace
}  // namespace anigen
