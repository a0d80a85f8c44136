#include "anigen/geometry/space_curve.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "anigen/core/random.h"

namespace anigen::geometry {
namespace {

double path_length(const std::vector<Eigen::Vector3d>& points, const std::vector<std::uint32_t>& order) {
  double length = 0.0;
  for (std::size_t i = 1; i < order.size(); ++i) length += (points[order[i]] - points[order[i - 1]]).norm();
  return length;
}

TEST(SpaceCurve, VisitsEveryPointOnceAndNeighboursTogether) {
  Rng rng(1, "points");
  std::vector<Eigen::Vector3d> points;
  std::vector<std::uint32_t> as_given;
  for (std::uint32_t i = 0; i < 2000; ++i) {
    points.emplace_back(rng.uniform(), rng.uniform(), rng.uniform());
    as_given.push_back(i);
  }
  const std::vector<std::uint32_t> order = along_curve(points);
  std::vector<std::uint32_t> sorted = order;
  std::sort(sorted.begin(), sorted.end());
  EXPECT_EQ(sorted, as_given);
  // Random order steps by 0.66 on average; 2,000 points are about 0.08 apart.
  EXPECT_LT(path_length(points, order), 0.25 * path_length(points, as_given));
}

TEST(SpaceCurve, DegenerateBoxesKeepTheOrder) {
  using Order = std::vector<std::uint32_t>;
  EXPECT_TRUE(along_curve({}).empty());
  EXPECT_EQ(along_curve({{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}), (Order{0, 1, 2}));
  constexpr double kHuge = std::numeric_limits<double>::max();
  EXPECT_EQ(along_curve({{-kHuge, 0, 0}, {kHuge, 0, 0}}).size(), 2u);
  EXPECT_EQ(along_curve({{0, 0, 0}, {std::numeric_limits<double>::denorm_min(), 0, 0}}).size(), 2u);
}

}  // namespace
}  // namespace anigen::geometry
