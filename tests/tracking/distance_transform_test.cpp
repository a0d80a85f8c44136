#include "anigen/tracking/distance_transform.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"

namespace anigen::tracking {
namespace {

double nearest_marked(const std::vector<std::uint8_t>& marked, int width, int height, int x, int y) {
  double nearest = std::numeric_limits<double>::infinity();
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      if (marked[at(width * v + u)] != 0) nearest = std::min(nearest, std::hypot(u - x, v - y));
    }
  }
  return nearest;
}

void expect_exact(const std::vector<std::uint8_t>& marked, int width, int height) {
  const std::vector<double> found = distance_transform(marked, width, height);
  ASSERT_EQ(found.size(), marked.size());
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x)
      ASSERT_DOUBLE_EQ(found[at(width * y + x)], nearest_marked(marked, width, height, x, y)) << x << ", " << y;
  }
}

TEST(DistanceTransform, IsThatOfAllPairs) {
  Rng rng(4, "silhouette");
  for (const auto& [width, height] : std::vector<std::pair<int, int>>{{1, 1}, {1, 9}, {9, 1}, {17, 23}, {40, 31}}) {
    for (const double share : {0.0, 0.005, 0.1, 0.6, 1.0}) {
      SCOPED_TRACE(std::to_string(width) + " x " + std::to_string(height) + ", share " + std::to_string(share));
      std::vector<std::uint8_t> marked(at(width * height));
      for (std::uint8_t& value : marked) value = rng.chance(share) ? 255 : 0;
      expect_exact(marked, width, height);
    }
  }
}

TEST(DistanceTransform, OfOnePixelIsACone) {
  for (const int place : {0, 11, 5 * 12 + 7, 9 * 12, 10 * 12 - 1}) {
    std::vector<std::uint8_t> marked(120, 0);
    marked[at(place)] = 1;
    expect_exact(marked, 12, 10);
  }
}

TEST(DistanceTransform, OfNothingIsInfinite) {
  for (const double distance : distance_transform(std::vector<std::uint8_t>(12, 0), 4, 3))
    EXPECT_TRUE(std::isinf(distance));
  EXPECT_TRUE(distance_transform({}, 0, 0).empty());
  EXPECT_THROW(distance_transform({1, 0, 0}, 2, 2), InputError);
}

}  // namespace
}  // namespace anigen::tracking
