#include <gtest/gtest.h>

#include "anigen/asset/mesh.h"
#include "anigen/core/error.h"

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

namespace {

std::vector<std::int32_t> faces_at(const MeshEdges& edges, std::int32_t a, std::int32_t b) {
  const MeshEdges::Faces faces = edges.faces(static_cast<std::size_t>(edges.find(a, b)));
  return {faces.begin(), faces.end()};
}

TEST(MeshEdges, AreListedInOrderWithTheirFaces) {
  // Two triangles at the edge 1-2, a third one there too, and a face that is only an edge.
  const std::vector<Triangle> faces{{0, 1, 2}, {2, 1, 3}, {1, 2, 4}, {3, 4, 4}};
  const MeshEdges edges(faces, 6);
  const std::vector<MeshEdges::Edge> expected{{0, 1}, {0, 2}, {1, 2}, {1, 3}, {1, 4}, {2, 3}, {2, 4}, {3, 4}};
  EXPECT_EQ(edges.all(), expected);
  EXPECT_EQ(faces_at(edges, 2, 1), (std::vector<std::int32_t>{0, 1, 2}));
  EXPECT_EQ(faces_at(edges, 0, 1), (std::vector<std::int32_t>{0}));
  EXPECT_EQ(faces_at(edges, 3, 4), (std::vector<std::int32_t>{3, 3}));
  EXPECT_EQ(edges.find(0, 3), -1);
  EXPECT_EQ(edges.find(5, 0), -1);
  for (std::size_t f = 0; f < 3; ++f) {
    for (std::size_t side = 0; side < 3; ++side)
      EXPECT_EQ(edges.of_face(f, side), edges.find(faces[f][side], faces[f][(side + 1) % 3]));
  }
  EXPECT_EQ(edges.of_face(3, 1), -1);  // from vertex 4 to itself
}

TEST(MeshEdges, RefusesAMissingVertex) {
  EXPECT_THROW(MeshEdges({{0, 1, 2}}, 2), InputError);
  EXPECT_THROW(MeshEdges({{0, -1, 1}}, 3), InputError);
  EXPECT_EQ(MeshEdges({}, 0).size(), 0u);
}

}  // namespace

}  // namespace anigen
