#include "anigen/geometry/nearest_point.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/random.h"

namespace anigen::geometry {
namespace {

std::size_t nearest_of_all(const std::vector<Eigen::Vector3d>& vertices, const Eigen::Vector3d& point) {
  std::size_t nearest = vertices.size();
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const double squared = (vertices[v] - point).squaredNorm();
    if (squared < least) {
      least = squared;
      nearest = v;
    }
  }
  return nearest;
}

TEST(PointIndex, AgreesWithLookingAtAll) {
  Rng rng(3, "test");
  const auto draw = [&] { return 2.0 * rng.uniform() - 1.0; };
  for (const std::size_t count : {std::size_t{1}, std::size_t{12}, std::size_t{13}, std::size_t{700}}) {
    std::vector<Eigen::Vector3d> vertices;
    for (std::size_t v = 0; v < count; ++v) vertices.emplace_back(draw(), draw(), 0.01 * draw());
    const PointIndex tree(vertices);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 300; ++i) points.emplace_back(1.5 * draw(), 1.5 * draw(), 1.5 * draw());
    const std::vector<std::size_t> found = tree.nearest(points);
    for (std::size_t i = 0; i < points.size(); ++i) EXPECT_EQ(found[i], nearest_of_all(vertices, points[i]));
  }
}

TEST(PointIndex, EquallyNearVerticesGiveTheLowestIndex) {
  // Points of a grid are as near to eight vertices, and every vertex is there three times.
  std::vector<Eigen::Vector3d> vertices;
  for (int copy = 0; copy < 3; ++copy) {
    for (int i = 0; i < 125; ++i) vertices.emplace_back(i / 25, i / 5 % 5, i % 5);
  }
  const PointIndex tree(vertices);
  for (int i = 0; i < 64; ++i) {
    const Eigen::Vector3d point(i / 16 + 0.5, i / 4 % 4 + 0.5, i % 4 + 0.5);
    EXPECT_EQ(tree.nearest(point).index, nearest_of_all(vertices, point)) << i;
  }
  const PointIndex same(std::vector<Eigen::Vector3d>(100, Eigen::Vector3d(1, 2, 3)));
  EXPECT_EQ(same.nearest(Eigen::Vector3d(0, 0, 0)).index, 0u);
}

TEST(PointIndex, RefusesWhatHasNoAnswer) {
  EXPECT_THROW(PointIndex{std::vector<Eigen::Vector3d>()}, InputError);
  EXPECT_THROW(PointIndex{std::vector<Eigen::Vector3d>(1, Eigen::Vector3d(0, NAN, 0))}, InputError);
  const PointIndex tree(std::vector<Eigen::Vector3d>{Eigen::Vector3d(0, 0, 0)});
  EXPECT_THROW(tree.nearest(std::vector<Eigen::Vector3d>{Eigen::Vector3d(INFINITY, 0, 0)}), InputError);
  EXPECT_TRUE(tree.nearest(std::vector<Eigen::Vector3d>()).empty());
}

}  // namespace
}  // namespace anigen::geometry
