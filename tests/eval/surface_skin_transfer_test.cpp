#include "anigen/eval/surface/skin_transfer.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/geometry/surface_sampling.h"
#include "tests/eval/align_shapes.h"

namespace anigen::eval {
namespace {

/// Weights of three joints that are linear in the position along the longest axis, so that interpolation is exact.
std::vector<float> weights_at(const Eigen::Vector3d& p) {
  const auto w = static_cast<float>(std::min(1.0, std::max(0.0, 0.5 + 0.5 * p.z())));
  return {0.25f, 0.75f * w, 0.75f * (1.0f - w)};
}

SkinWeights linear_skin(const std::vector<Eigen::Vector3f>& vertices) {
  std::vector<float> dense;
  for (const Eigen::Vector3f& vertex : vertices) {
    for (const float weight : weights_at(vertex.cast<double>())) dense.push_back(weight);
  }
  return from_dense(dense, vertices.size(), 3);
}

double largest_error(const SkinWeights& skin, const std::vector<Eigen::Vector3d>& points) {
  const std::vector<float> dense = to_dense(skin, 3);
  double largest = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::vector<float> truth = weights_at(points[i]);
    for (std::size_t j = 0; j < 3; ++j) largest = std::max(largest, double{std::abs(dense[3 * i + j] - truth[j])});
  }
  return largest;
}

TEST(SkinTransfer, ToItsOwnVerticesChangesNothing) {
  const Mesh mesh = test::walker(7);
  const SkinWeights skin = linear_skin(mesh.vertices);
  std::vector<Eigen::Vector3d> points;
  for (const Eigen::Vector3f& vertex : mesh.vertices) points.push_back(vertex.cast<double>());
  EXPECT_LT(largest_error(transfer_skin(mesh, skin, points), points), 1e-6);
  EXPECT_LT(largest_error(transfer_skin_by_vertex(points, skin, points), points), 1e-6);
}

TEST(SkinTransfer, IsExactForLinearWeightsWhereTheNearestVertexIsNot) {
  const Mesh mesh = test::walker(7);
  const SkinWeights skin = linear_skin(mesh.vertices);
  Rng rng(1, "points");
  std::vector<Eigen::Vector3d> points, vertices;
  for (const auto& at : geometry::sample_surface(mesh.vertices, mesh.faces, 500, rng)) {
    points.push_back(geometry::position(at, mesh.vertices, mesh.faces));
  }
  for (const Eigen::Vector3f& vertex : mesh.vertices) vertices.push_back(vertex.cast<double>());
  const SkinWeights moved = transfer_skin(mesh, skin, points);
  ASSERT_EQ(moved.rows(), points.size());
  EXPECT_LT(largest_error(moved, points), 1e-5);
  EXPECT_GT(largest_error(transfer_skin_by_vertex(vertices, skin, points), points), 1e-2);
}

TEST(SkinTransfer, RefusesBadInput) {
  const Mesh mesh = test::walker(4);
  const SkinWeights skin = linear_skin(mesh.vertices);
  EXPECT_THROW(transfer_skin(Mesh{}, SkinWeights{}, {{0, 0, 0}}), InputError);
  EXPECT_THROW(transfer_skin(mesh, SkinWeights{}, {{0, 0, 0}}), InputError);
  EXPECT_THROW(transfer_skin(mesh, skin, {{NAN, 0, 0}}), InputError);
  EXPECT_THROW(transfer_skin_by_vertex({}, SkinWeights{}, {{0, 0, 0}}), InputError);
  EXPECT_THROW(transfer_skin_by_vertex({{0, 0, 0}}, SkinWeights{}, {{0, 0, 0}}), InputError);
  EXPECT_EQ(transfer_skin(mesh, skin, {}).rows(), 0u);
}

}  // namespace
}  // namespace anigen::eval
