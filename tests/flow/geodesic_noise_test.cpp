#include "anigen/flow/geodesic_noise.h"

#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/error.h"

namespace anigen::flow {
namespace {

GeodesicNoiseOptions smoothing(std::int64_t iterations, double alpha) {
  GeodesicNoiseOptions options;
  options.enabled = true;
  options.iterations = iterations;
  options.alpha = alpha;
  return options;
}

Tensor voxel_rows(const std::vector<int>& numbers) { return torch::tensor(numbers, torch::kInt32).view({-1, 4}); }

TEST(GeodesicNoise, GoldenNumbers) {
  // docs/reference/flows.md, 7.2
  const Tensor coords = voxel_rows({0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 5, 5, 5});
  const Tensor noise = torch::tensor({9.0, 8.0, 7.0, 6.0, 1.0, 4.0, 7.0, -2.0}, torch::kFloat64).view({2, 4}).t();
  const Tensor smoothed = smooth_geodesic_noise(noise, coords, 1, 2, smoothing(2, 0.7));
  const std::vector<double> golden = {1.2399899, 1.3297479, 1.4195058, -0.6648740};
  for (std::int64_t i = 0; i < 4; ++i)
    EXPECT_NEAR(smoothed[i][1].item<double>(), golden[static_cast<std::size_t>(i)], 1e-7);
  EXPECT_TRUE(torch::equal(smoothed.select(1, 0), noise.select(1, 0)));
}

TEST(GeodesicNoise, NeighboursShareAFaceInsideAnItem) {
  // A corner with its three neighbours, a diagonal one, and the place of a neighbour in another item; the last row
  // would follow the largest coordinate if numbers wrapped around.
  const Tensor coords =
      voxel_rows({0, 0, 0, 2, 0, 1, 0, 2, 0, 0, 1, 2, 0, 0, 0, 1, 0, 1, 1, 1, 0, 0, 1, 0, 1, 0, 0, 1, 1, 2, 0, 0});
  const FaceNeighbours found = face_neighbours(coords);
  std::vector<std::vector<bool>> pairs(8, std::vector<bool>(8, false));
  for (std::int64_t e = 0; e < found.row.size(0); ++e) {
    pairs[static_cast<std::size_t>(found.row[e].item<std::int64_t>())]
         [static_cast<std::size_t>(found.neighbour[e].item<std::int64_t>())] = true;
  }
  std::int64_t edges = 0;
  for (std::int64_t a = 0; a < 8; ++a) {
    std::int64_t degree = 0;
    for (std::int64_t b = 0; b < 8; ++b) {
      const auto difference = (coords[a] - coords[b]).abs();
      const bool share = difference[0].item<int>() == 0 && difference.sum().item<int>() == 1;
      EXPECT_EQ(pairs[static_cast<std::size_t>(a)][static_cast<std::size_t>(b)], share) << a << ", " << b;
      degree += share ? 1 : 0;
    }
    EXPECT_EQ(found.degree[a].item<std::int64_t>(), degree);
    edges += degree;
  }
  EXPECT_EQ(found.row.size(0), edges);
}

TEST(GeodesicNoise, FullGridMatchesADenseAverage) {
  torch::manual_seed(4);
  constexpr std::int64_t kSide = 5;
  const Tensor places = torch::ones({kSide, kSide, kSide}).nonzero();
  const Tensor coords = torch::cat({torch::zeros({places.size(0), 1}, torch::kInt64), places}, 1);
  const Tensor noise = torch::randn({places.size(0), 3}, torch::kFloat64);
  const Tensor cross = torch::zeros({1, 1, 3, 3, 3}, torch::kFloat64);
  for (const auto& [i, j, k] : {std::array{0, 1, 1}, std::array{2, 1, 1}, std::array{1, 0, 1}, std::array{1, 2, 1},
                                std::array{1, 1, 0}, std::array{1, 1, 2}}) {
    cross[0][0][i][j][k] = 1.0;
  }
  const auto summed = [&](const Tensor& grid) { return torch::conv3d(grid, cross, {}, 1, 1); };
  Tensor grid = noise.t().reshape({3, 1, kSide, kSide, kSide});
  const Tensor degree = summed(torch::ones_like(grid));
  for (int i = 0; i < 4; ++i) grid = 0.4 * grid + 0.6 * summed(grid) / degree;
  Tensor expected = grid.reshape({3, -1}).t();
  expected = expected / expected.std(0, true, true);
  const Tensor found = smooth_geodesic_noise(noise, coords, 0, 3, smoothing(4, 0.6));
  EXPECT_LT((found - expected).abs().max().item<double>(), 1e-13);
}

TEST(GeodesicNoise, LeavesNoiseAloneUnlessEnabled) {
  const Tensor coords = voxel_rows({0, 0, 0, 0, 0, 0, 0, 1}), noise = torch::randn({2, 3});
  GeodesicNoiseOptions options = smoothing(5, 0.7);
  options.enabled = false;
  EXPECT_TRUE(torch::equal(smooth_geodesic_noise(noise, coords, 0, 3, options), noise));
  const Tensor alone = torch::randn({1, 3});  // one voxel: no neighbour, and no deviation to divide by
  const Tensor one = voxel_rows({0, 3, 3, 3}), none = torch::empty({0, 4}, torch::kInt32);
  EXPECT_TRUE(torch::equal(smooth_geodesic_noise(alone, one, 0, 3, smoothing(5, 0.7)), alone));
  EXPECT_EQ(smooth_geodesic_noise(torch::empty({0, 3}), none, 0, 3, smoothing(5, 0.7)).size(0), 0);
}

TEST(GeodesicNoise, ReadsItsArguments) {
  const auto read = [](const char* text) {
    const Json json = Json::parse(text);
    ConfigReader reader(json, "flow.json", "/trainer/args");
    const GeodesicNoiseOptions options = GeodesicNoiseOptions::read(reader);
    reader.finish();
    return options;
  };
  EXPECT_FALSE(read("{}").enabled);
  EXPECT_EQ(read("{}").alpha, 0.7);
  const GeodesicNoiseOptions options =
      read(R"({"geodesic_smooth_noise": true, "geodesic_smooth_noise_iters": 3, "geodesic_smooth_noise_alpha": 0.5})");
  EXPECT_TRUE(options.enabled);
  EXPECT_EQ(options.iterations, 3);
  EXPECT_EQ(options.alpha, 0.5);
  EXPECT_THROW(read(R"({"geodesic_smooth_noise_iters": -1})"), InputError);
  EXPECT_THROW(read(R"({"geodesic_smooth_noise_alpha": 1.5})"), InputError);
}

}  // namespace
}  // namespace anigen::flow
