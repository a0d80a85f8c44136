#include "anigen/asset/angle_normals.h"

#include <gtest/gtest.h>

namespace anigen {
namespace {

// The corner of a cube: one side in one triangle, one in two, one in two of which one is ten times as large.
TEST(AngleWeightedNormals, DoNotDependOnHowSidesAreCut) {
  const std::vector<Eigen::Vector3f> vertices{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 0}, {0, 10, 10}};
  const std::vector<Triangle> faces{{0, 1, 3}, {0, 4, 1}, {0, 2, 4}, {0, 5, 2}, {0, 3, 5}};
  const std::vector<Eigen::Vector3f> normals = angle_weighted_normals(vertices, faces);
  const Eigen::Vector3f diagonal = -Eigen::Vector3f::Ones().normalized();
  EXPECT_LT((normals[0] - diagonal).norm(), 1e-6f);
  EXPECT_GT((vertex_normals(vertices, faces)[0] - diagonal).norm(), 0.1f);
}

TEST(AngleWeightedNormals, PointUpWithoutAFaceThatHasArea) {
  const std::vector<Eigen::Vector3f> normals = angle_weighted_normals({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {{0, 1, 2}});
  for (const Eigen::Vector3f& normal : normals) EXPECT_EQ(normal, Eigen::Vector3f::UnitZ());
}

}  // namespace
}  // namespace anigen
