#include "anigen/prepare/split.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <set>

#include "anigen/core/error.h"

namespace anigen::prepare {
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
  for (const double bad : {-0.1, 1.5, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_THROW(test_count(3, bad), InputError) << bad;
  }
}

}  // namespace
}  // namespace anigen::prepare
