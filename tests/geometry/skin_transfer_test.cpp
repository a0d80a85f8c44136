#include "anigen/geometry/skin_transfer.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/geometry/primitive_meshes.h"
#include "anigen/geometry/simplify.h"

namespace anigen::geometry {
namespace {

/// A square in two triangles, bound to four joints, one per corner.
Mesh square() {
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  mesh.faces = {{0, 1, 2}, {0, 2, 3}};
  mesh.colors = {{1, 0, 0, 1}, {0, 1, 0, 1}, {0, 0, 1, 1}, {0, 0, 0, 0}};
  return mesh;
}

SkinWeights corners() {
  SkinWeights skin;
  for (std::int32_t j = 0; j < 4; ++j) skin.append_row({{j, 1.0f}});
  return skin;
}

TEST(TransferAttributes, InterpolatesAtTheNearestPlace) {
  const auto result = transfer_attributes(square(), corners(), {{0.5f, 0.25f, 3.0f}, {2.0f, 2.0f, 0.0f}, {0, 1, -1}});
  const std::vector<float> expected{.5f, .25f, .25f, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  const std::vector<float> dense = to_dense(result.skin, 4);
  ASSERT_EQ(dense.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(dense[i], expected[i], 1e-6);
  ASSERT_EQ(result.colors.size(), 3u);
  EXPECT_LT((result.colors[0] - Eigen::Vector4f(0.5f, 0.25f, 0.25f, 1.0f)).norm(), 1e-6f);
  EXPECT_EQ(result.colors[2], Eigen::Vector4f(0, 0, 0, 0));
}

TEST(TransferAttributes, GivesASimplifiedMeshTheWeightsOfTheOriginal) {
  const Mesh sphere = icosphere(4, 0.5);
  SkinWeights skin;  // weight of joint 1 rises from the south pole to the north pole
  for (const Eigen::Vector3f& vertex : sphere.vertices)
    skin.append_row({{0, 0.5f - vertex.z()}, {1, 0.5f + vertex.z()}});
  const Mesh simple = simplify(sphere.vertices, sphere.faces, 256).mesh;
  const auto result = transfer_attributes(sphere, skin, simple.vertices);
  ASSERT_EQ(result.skin.rows(), simple.vertices.size());
  EXPECT_TRUE(result.colors.empty());
  const std::vector<float> dense = to_dense(result.skin, 2);
  for (std::size_t v = 0; v < simple.vertices.size(); ++v) {
    // Simplified vertices lie within 0.01 of the surface, whose weights change by 1 per unit.
    EXPECT_NEAR(dense[2 * v + 1], 0.5f + simple.vertices[v].z(), 0.01);
  }
}

TEST(TransferAttributes, RefusesArraysOfAnotherLength) {
  SkinWeights short_skin;
  short_skin.append_row({{0, 1.0f}});
  EXPECT_THROW(transfer_attributes(square(), short_skin, {}), InputError);
  Mesh mesh = square();
  mesh.colors.pop_back();
  EXPECT_THROW(transfer_attributes(mesh, corners(), {}), InputError);
  mesh = square();
  mesh.faces.clear();
  EXPECT_THROW(transfer_attributes(mesh, corners(), {}), InputError);
  EXPECT_EQ(transfer_attributes(square(), SkinWeights(), {{0, 0, 0}}).skin.rows(), 0u);
}

}  // namespace
}  // namespace anigen::geometry
