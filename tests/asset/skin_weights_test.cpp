#include <gtest/gtest.h>
#include <limits>
#include <numeric>

#include "anigen/asset/skin_weights.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"

namespace anigen {

namespace {

TEST(SkinWeights, AppendRowMergesDropsNormalisesAndSorts) {
  SkinWeights skin;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(skin.append_row({{2, 1.0f}, {5, 2.0f}, {2, 1.0f}, {7, nan}, {8, -1.0f}, {9, 0.0f}, {1, 4.0f}}));
  ASSERT_EQ(skin.row_size(0), 3u);
  EXPECT_EQ(skin.row(0)[0].joint, 1);
  EXPECT_FLOAT_EQ(skin.row(0)[0].weight, 0.5f);
  EXPECT_EQ(skin.row(0)[1].joint, 2);  // equal weights: lower joint first
  EXPECT_FLOAT_EQ(skin.row(0)[1].weight, 0.25f);
  EXPECT_FALSE(skin.append_row({{0, nan}}));
  EXPECT_EQ(skin.row_size(1), 0u);
  EXPECT_EQ(skin.rows(), 2u);
}

TEST(SkinWeights, LimitKeepsTheHeaviestAndCompleteRowsUntouched) {
  SkinWeights skin;
  skin.append_row({{0, 0.4f}, {1, 0.3f}, {2, 0.2f}, {3, 0.1f}});
  skin.append_row({{0, 0.7f}, {1, 0.3f}});
  const SkinWeights limited = limit_influences(skin, 2);
  ASSERT_EQ(limited.row_size(0), 2u);
  EXPECT_NEAR(limited.row(0)[0].weight, 0.4 / 0.7, 1e-6);
  EXPECT_EQ(limited.row(1)[0].weight, skin.row(1)[0].weight);
  EXPECT_EQ(skin.largest_row(), 4u);
}

TEST(SkinWeights, DenseAndBack) {
  const std::vector<float> dense{0.25f, 0.0f, 0.75f, 0.0f, 0.0f, 0.0f};
  const SkinWeights skin = from_dense(dense, 2, 3);
  EXPECT_EQ(to_dense(skin, 3), (std::vector<float>{0.25f, 0.0f, 0.75f, 1.0f, 0.0f, 0.0f}));  // empty row: joint 0
}

}  // namespace

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

// The golden rows of docs/reference/flows.md, 7.2.
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

namespace {

/// A path 0-1-2-…: faces that are only an edge have no other.
MeshEdges path(std::int32_t vertices) {
  std::vector<Triangle> faces;
  for (std::int32_t v = 0; v + 1 < vertices; ++v) faces.push_back({v, v + 1, v + 1});
  return MeshEdges(faces, static_cast<std::size_t>(vertices));
}

/// A square grid of side · side vertices.
std::vector<Triangle> grid(std::int32_t side) {
  std::vector<Triangle> faces;
  for (std::int32_t i = 0; i + 1 < side; ++i) {
    for (std::int32_t j = 0; j + 1 < side; ++j) {
      const std::int32_t a = i * side + j;
      faces.push_back({a, a + 1, a + side});
      faces.push_back({a + 1, a + side + 1, a + side});
    }
  }
  return faces;
}

SkinWeights random_skin(std::size_t rows, std::size_t joints, std::uint64_t seed) {
  Rng rng(seed, "skin");
  SkinWeights skin;
  for (std::size_t v = 0; v < rows; ++v) {
    std::vector<Influence> row;
    for (std::size_t j = 0; j < joints; ++j) {
      if (rng.uniform() < 0.2) row.push_back({static_cast<std::int32_t>(j), static_cast<float>(rng.uniform())});
    }
    skin.append_row(row);
  }
  return skin;
}

/// The definition, dense and in double, one entry after the other.
std::vector<double> plainly_smoothed(const SkinWeights& skin, const MeshEdges& edges, std::size_t joints,
                                     int iterations, double alpha) {
  const std::vector<float> start = to_dense(skin, joints);
  std::vector<double> w(start.begin(), start.end());
  std::vector<double> degree(skin.rows(), 0.0);
  for (const auto& [a, b] : edges.all()) {
    degree[static_cast<std::size_t>(a)] += 1.0;
    degree[static_cast<std::size_t>(b)] += 1.0;
  }
  for (int i = 0; i < iterations; ++i) {
    std::vector<double> next(w.size(), 0.0);
    for (const auto& edge : edges.all()) {
      const auto a = static_cast<std::size_t>(edge[0]), b = static_cast<std::size_t>(edge[1]);
      for (std::size_t j = 0; j < joints; ++j) {
        next[a * joints + j] += alpha * w[b * joints + j] / degree[a];
        next[b * joints + j] += alpha * w[a * joints + j] / degree[b];
      }
    }
    for (std::size_t v = 0; v < skin.rows(); ++v) {
      double sum = 0.0;
      for (std::size_t j = 0; j < joints; ++j) sum += next[v * joints + j] += (1.0 - alpha) * w[v * joints + j];
      for (std::size_t j = 0; j < joints && sum > 0.0; ++j) next[v * joints + j] /= sum;
    }
    w = next;
  }
  return w;
}

void expect_smoothed_rows(const SkinWeights& skin, std::size_t joints, const std::vector<double>& expected) {
  const std::vector<float> dense = to_dense(skin, joints);
  ASSERT_EQ(dense.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) ASSERT_NEAR(dense[i], expected[i], 2e-6) << "entry " << i;
}

// The golden rows of docs/reference/flows.md, 7.2.
TEST(SmoothSkin, LeavesTheVertexItselfOut) {
  SkinWeights skin;
  skin.append_row({{0, 1.0f}});
  skin.append_row({{0, 0.6f}, {1, 0.4f}});
  skin.append_row({{1, 0.2f}, {2, 0.5f}, {3, 0.3f}});
  skin.append_row({{2, 0.1f}, {3, 0.9f}});
  SkinSmoothing options;
  options.iterations = 2;
  expect_smoothed_rows(smooth_skin(skin, path(4), 4, options), 4,
                       {.5, .1, .25, .15, .45, .3, .025, .225, .25, .15, .375, .225, .3, .2, .05, .45});
}

TEST(SmoothSkin, FollowsTheDefinitionOverManyJointsAndRowsWithoutWeights) {
  constexpr std::size_t kJoints = 37;
  const MeshEdges edges(grid(12), 144);
  SkinWeights skin = random_skin(144, kJoints, 3);
  // A corner of the grid without weights: they come in from its border, one step per iteration.
  SkinWeights holed;
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    holed.append_row(v % 12 < 5 && v / 12 < 5 ? std::vector<Influence>{}
                                              : std::vector<Influence>{skin.row(v), skin.row(v) + skin.row_size(v)});
  }
  for (const double alpha : {1.0, 0.5}) {
    for (const int iterations : {1, 3, 40}) {
      SkinSmoothing options;
      options.alpha = alpha;
      options.iterations = iterations;
      options.empties_isolated = true;
      expect_smoothed_rows(smooth_skin(holed, edges, kJoints, options), kJoints,
                           plainly_smoothed(holed, edges, kJoints, iterations, alpha));
    }
  }
}

TEST(SmoothSkin, KeepsRowsSummingToOneAndEqualRowsEqual) {
  const MeshEdges edges(grid(20), 400);
  const SkinWeights smooth = smooth_skin(random_skin(400, 20, 5), edges, 20);
  SkinWeights constant;
  for (std::size_t v = 0; v < 400; ++v) {
    double sum = 0.0;
    for (std::size_t i = 0; i < smooth.row_size(v); ++i) sum += smooth.row(v)[i].weight;
    EXPECT_NEAR(sum, 1.0, 1e-6);
    constant.append_row({{3, 0.25f}, {17, 0.75f}});
  }
  const SkinWeights same = smooth_skin(constant, edges, 20);
  for (std::size_t v = 0; v < 400; ++v) {
    ASSERT_EQ(same.row_size(v), 2u);
    EXPECT_EQ(same.row(v)[0].joint, 17);
    EXPECT_NEAR(same.row(v)[0].weight, 0.75f, 1e-6);
  }
}

TEST(SmoothSkin, AnIsolatedVertexKeepsItsWeightsUnlessAskedToBeAsPublished) {
  const MeshEdges edges({{0, 1, 1}}, 3);
  SkinWeights skin;
  skin.append_row({{0, 1.0f}});
  skin.append_row({{1, 1.0f}});
  skin.append_row({{0, 0.25f}, {1, 0.75f}});
  SkinSmoothing options;
  expect_smoothed_rows(smooth_skin(skin, edges, 2, options), 2, {1, 0, 0, 1, .25, .75});  // 100 swaps
  options.iterations = 1;
  expect_smoothed_rows(smooth_skin(skin, edges, 2, options), 2, {0, 1, 1, 0, .25, .75});
  options.empties_isolated = true;
  EXPECT_EQ(smooth_skin(skin, edges, 2, options).row_size(2), 0u);
  options.alpha = 0.5;
  expect_smoothed_rows(smooth_skin(skin, edges, 2, options), 2, {.5, .5, .5, .5, .25, .75});
}

TEST(SmoothSkin, DoesNotDependOnThreads) {
  const MeshEdges edges(grid(15), 225);
  const SkinWeights skin = random_skin(225, 50, 9);
  set_thread_count(1);
  const std::vector<float> alone = to_dense(smooth_skin(skin, edges, 50), 50);
  set_thread_count(0);
  EXPECT_EQ(to_dense(smooth_skin(skin, edges, 50), 50), alone);
}

TEST(SmoothSkin, RefusesWhatDoesNotFitTogether) {
  const SkinWeights skin = random_skin(4, 3, 1);
  EXPECT_THROW(smooth_skin(skin, path(5), 3), InputError);
  SkinWeights far;
  far.append_row({{7, 1.0f}});
  EXPECT_THROW(smooth_skin(far, MeshEdges({}, 1), 3), InputError);
  SkinSmoothing options;
  options.iterations = -1;
  EXPECT_THROW(smooth_skin(skin, path(4), 3, options), InputError);
  options.iterations = 1;
  options.alpha = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(smooth_skin(skin, path(4), 3, options), InputError);
}

}  // namespace

}  // namespace anigen
