#include "anigen/geometry/crossings.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/geometry/primitives.h"

namespace anigen::geometry {
namespace {

FaceMarks crossed(const Mesh& mesh) {
  return crossed_faces(mesh.vertices, mesh.faces, MeshEdges(mesh.faces, mesh.vertices.size()));
}

/// Two spheres of radius 0.5 whose middles are `apart` from each other.
Mesh two_spheres(float apart) {
  Mesh mesh = icosphere(2, 0.5);
  const auto count = static_cast<std::int32_t>(mesh.vertices.size());
  const Mesh other = icosphere(2, 0.5);
  for (const Eigen::Vector3f& vertex : other.vertices)
    mesh.vertices.push_back(vertex + Eigen::Vector3f(apart, 0.01f, 0.02f));
  for (const Triangle& face : other.faces) mesh.faces.push_back({face[0] + count, face[1] + count, face[2] + count});
  return mesh;
}

TEST(CrossedFaces, MarkBothOfTwoTriangles) {
  Mesh mesh;
  mesh.vertices = {{-1, -1, 0}, {1, -1, 0}, {0, 1, 0}, {0, 0, -1}, {0.1f, 0, 1}, {0, 5, 1}};
  mesh.faces = {{0, 1, 2}, {3, 4, 5}};
  EXPECT_EQ(crossed(mesh), (FaceMarks{1, 1}));
  for (std::size_t v = 3; v < 6; ++v) mesh.vertices[v].z() += 2.0f;
  EXPECT_EQ(crossed(mesh), (FaceMarks{0, 0}));
}

TEST(CrossedFaces, OfNeighboursCountOnlyBeyondWhatTheyShare) {
  const FaceMarks marks = crossed(icosphere(3, 0.5));
  EXPECT_EQ(std::count(marks.begin(), marks.end(), char{1}), 0);
  // A face that goes through its neighbour by the edge that they do not share.
  Mesh fold;
  fold.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0.6f, 0.2f, -0.5f}, {0.2f, 0.6f, 0.5f}};
  fold.faces = {{0, 1, 2}, {0, 3, 4}};
  EXPECT_EQ(crossed(fold), (FaceMarks{1, 1}));
}

TEST(CrossedFaces, OfSpheresLieInARing) {
  FaceMarks marks = crossed(two_spheres(1.2f));
  EXPECT_EQ(std::count(marks.begin(), marks.end(), char{1}), 0);
  const Mesh mesh = two_spheres(0.6f);
  marks = crossed(mesh);
  const auto count = static_cast<std::size_t>(std::count(marks.begin(), marks.end(), char{1}));
  EXPECT_GT(count, 20U);
  EXPECT_LT(count, mesh.faces.size() / 2);
  for (std::size_t f = 0; f < marks.size(); ++f) {
    if (marks[f] == 0) continue;
    for (const std::int32_t corner : mesh.faces[f])
      EXPECT_NEAR(mesh.vertices[static_cast<std::size_t>(corner)].x(), 0.3f, 0.3f);
  }
}

TEST(CrossedFaces, RefuseBadMeshes) {
  EXPECT_TRUE(crossed(Mesh()).empty());
  Mesh mesh = icosphere(0, 1.0);
  const MeshEdges edges(mesh.faces, mesh.vertices.size());
  mesh.vertices[0].x() = NAN;
  EXPECT_THROW(crossed_faces(mesh.vertices, mesh.faces, edges), InputError);
}

}  // namespace
}  // namespace anigen::geometry
