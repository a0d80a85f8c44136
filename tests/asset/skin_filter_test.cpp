#include "anigen/asset/skin_filter.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"

namespace anigen {
namespace {

/// Distances along a chain of joints.
std::vector<std::vector<int>> chain_hops(int joints) {
  std::vector<std::vector<int>> hops(static_cast<std::size_t>(joints));
  for (int a = 0; a < joints; ++a) {
    for (int b = 0; b < joints; ++b) hops[static_cast<std::size_t>(a)].push_back(std::abs(a - b));
  }
  return hops;
}

/// Row-major [rows, 4] as it is, rows without weights included.
SkinWeights rows_of(const std::vector<float>& dense) {
  SkinWeights skin;
  for (std::size_t v = 0; v < dense.size(); v += 4) {
    skin.append_row({{0, dense[v]}, {1, dense[v + 1]}, {2, dense[v + 2]}, {3, dense[v + 3]}});
  }
  return skin;
}

void expect_rows(const SkinWeights& skin, const std::vector<float>& expected) {
  const std::vector<float> dense = to_dense(skin, 4);
  ASSERT_EQ(dense.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(dense[i], expected[i], 1e-6) << "entry " << i;
}

// The golden rows of reference flows-and-pipeline.md, A.4.
TEST(FilterSkin, DropsJointsBeyondTheHopsFromTheHeaviest) {
  const SkinWeights skin = rows_of({.5f, .2f, .2f, .1f, .1f, .5f, .2f, .2f, 0, 0, 0, 0, .25f, .25f, .25f, .25f});
  expect_rows(filter_skin(skin, chain_hops(4), 2),
              {.5f / .9f, .2f / .9f, .2f / .9f, 0, .1f, .5f, .2f, .2f, 1, 0, 0, 0, 1 / 3.f, 1 / 3.f, 1 / 3.f, 0});
}

TEST(FilterSkin, TakesAnchorsThatAreGiven) {
  const SkinWeights skin = rows_of({.5f, .3f, .2f, 0, 1, 0, 0, 0});
  // The second row has no weight near joint 3 and becomes one with it.
  expect_rows(filter_skin(skin, chain_hops(4), 1, {2, 3}), {0, .6f, .4f, 0, 0, 0, 0, 1});
}

TEST(FilterSkin, HopsGrowWithTheSkeleton) {
  EXPECT_EQ(published_max_hops(1), 2);
  EXPECT_EQ(published_max_hops(19), 2);
  EXPECT_EQ(published_max_hops(20), 4);
  EXPECT_EQ(published_max_hops(60), 12);
}

TEST(FilterSkin, RefusesJointsThatAreNotThere) {
  const SkinWeights skin = rows_of({0, 0, 0, 1});
  EXPECT_THROW(filter_skin(skin, chain_hops(3), 2), InputError);
  EXPECT_THROW(filter_skin(skin, chain_hops(4), 2, {4}), InputError);
  EXPECT_THROW(filter_skin(skin, chain_hops(4), 2, {0, 0}), InputError);
  EXPECT_THROW(filter_skin(skin, {}, 2), InputError);
  EXPECT_THROW(filter_skin(skin, {{0, 1}, {1}}, 2), InputError);
}

}  // namespace
}  // namespace anigen
