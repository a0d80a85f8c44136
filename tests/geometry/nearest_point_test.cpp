#include "anigen/geometry/nearest_point.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/random.h"

namespace anigen::geometry {
namespace {

std::int32_t nearest_of_all(const std::vector<Eigen::Vector3f>& vertices, const Eigen::Vector3d& point) {
  std::int32_t nearest = -1;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const double squared = (vertices[v].cast<double>() - point).squaredNorm();
    if (squared < least) {
      least = squared;
      nearest = static_cast<std::int32_t>(v);
    }
  }
  return nearest;
}

TEST(NearestVertex, AgreesWithLookingAtAll) {
  Rng rng(3, "test");
  const auto draw = [&] { return 2.0 * rng.uniform() - 1.0; };
  for (const std::size_t count : {std::size_t{1}, std::size_t{12}, std::size_t{13}, std::size_t{700}}) {
    std::vector<Eigen::Vector3f> vertices;
    for (std::size_t v = 0; v < count; ++v) {
      vertices.push_back(Eigen::Vector3d(draw(), draw(), 0.01 * draw()).cast<float>());
    }
    const NearestVertex tree(vertices);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 300; ++i) points.emplace_back(1.5 * draw(), 1.5 * draw(), 1.5 * draw());
    const std::vector<std::int32_t> found = tree.query(points);
    for (std::size_t i = 0; i < points.size(); ++i) EXPECT_EQ(found[i], nearest_of_all(vertices, points[i]));
  }
}

TEST(NearestVertex, EquallyNearVerticesGiveTheLowestIndex) {
  // Points of a grid are as near to eight vertices, and every vertex is there three times.
  std::vector<Eigen::Vector3f> vertices;
  for (int copy = 0; copy < 3; ++copy) {
    for (int i = 0; i < 125; ++i) {
      vertices.emplace_back(static_cast<float>(i / 25), static_cast<float>(i / 5 % 5), static_cast<float>(i % 5));
    }
  }
  const NearestVertex tree(vertices);
  for (int i = 0; i < 64; ++i) {
    const Eigen::Vector3d point(i / 16 + 0.5, i / 4 % 4 + 0.5, i % 4 + 0.5);
    EXPECT_EQ(tree.query(point), nearest_of_all(vertices, point)) << i;
  }
  const NearestVertex same(std::vector<Eigen::Vector3f>(100, Eigen::Vector3f(1, 2, 3)));
  EXPECT_EQ(same.query(Eigen::Vector3d(0, 0, 0)), 0);
}

TEST(NearestVertex, RefusesWhatHasNoAnswer) {
  EXPECT_THROW(NearestVertex{std::vector<Eigen::Vector3f>()}, InputError);
  EXPECT_THROW(NearestVertex{std::vector<Eigen::Vector3f>(1, Eigen::Vector3f(0, NAN, 0))}, InputError);
  const NearestVertex tree({Eigen::Vector3f(0, 0, 0)});
  EXPECT_THROW(tree.query(std::vector<Eigen::Vector3d>{Eigen::Vector3d(INFINITY, 0, 0)}), InputError);
  EXPECT_TRUE(tree.query(std::vector<Eigen::Vector3d>()).empty());
}

}  // namespace
}  // namespace anigen::geometry
