#include "anigen/geometry/fill_holes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/primitives.h"
#include "tests/geometry/mesh_shape.h"

namespace anigen::geometry {
namespace {

/// A sphere without the faces whose middle is higher than `top`.
Mesh open_sphere(int subdivisions, float top) {
  Mesh mesh = icosphere(subdivisions, 0.5);
  mesh.faces.erase(std::remove_if(mesh.faces.begin(), mesh.faces.end(),
                                  [&](const Triangle& face) {
                                    float height = 0.0f;
                                    for (const std::int32_t v : face) height += mesh.vertices[at(v)].z() / 3.0f;
                                    return height > top;
                                  }),
                   mesh.faces.end());
  return mesh;
}

/// A cone without its base: one hole of `sections` edges.
Mesh open_cone(int sections) {
  Mesh mesh = cone({0, 0, 0}, {0, 0, 1}, 0.5, sections);
  mesh.faces.erase(
      std::remove_if(mesh.faces.begin(), mesh.faces.end(), [](const Triangle& face) { return face[0] == 0; }),
      mesh.faces.end());
  return mesh;
}

double edge_length(const Mesh& mesh, std::int32_t a, std::int32_t b) {
  return (mesh.vertices[at(a)] - mesh.vertices[at(b)]).norm();
}

TEST(FillHoles, ClosesASphereWithTrianglesOfItsSize) {
  const Mesh open = open_sphere(3, 0.45f);
  const std::size_t border = test::edge_census(open.faces).border;
  ASSERT_GT(border, 8u);
  ASSERT_LE(border, 32u);
  const FilledMesh result = fill_holes(open.vertices, open.faces);
  EXPECT_EQ(result.filled, 1u);
  EXPECT_EQ(result.left_open, 0u);
  EXPECT_TRUE(test::edge_census(result.mesh.faces).is_closed());
  EXPECT_EQ(test::euler_characteristic(result.mesh), 2);
  // The missing volume is at most the cap above the lowest vertex of the hole, with height h π h² (3 r - h) / 3.
  const double sphere = kPi / 6.0, height = 0.08, cap = kPi * height * height * (1.5 - height) / 3.0;
  EXPECT_GT(test::enclosed_volume(result.mesh), 0.98 * (sphere - cap));
  EXPECT_LT(test::enclosed_volume(result.mesh), sphere);
  // Old vertices and faces stay as they were.
  ASSERT_GT(result.mesh.vertices.size(), open.vertices.size());
  EXPECT_TRUE(std::equal(open.vertices.begin(), open.vertices.end(), result.mesh.vertices.begin()));
  EXPECT_TRUE(std::equal(open.faces.begin(), open.faces.end(), result.mesh.faces.begin()));
  double longest_old = 0.0, longest_new = 0.0;
  for (std::size_t f = 0; f < result.mesh.faces.size(); ++f) {
    const Triangle& face = result.mesh.faces[f];
    double& longest = f < open.faces.size() ? longest_old : longest_new;
    for (std::size_t k = 0; k < 3; ++k)
      longest = std::max(longest, edge_length(result.mesh, face[k], face[(k + 1) % 3]));
  }
  EXPECT_LT(longest_new, 2.0 * longest_old);
}

TEST(FillHoles, WithoutRefinementAddsNoVertices) {
  const Mesh open = open_sphere(3, 0.45f);
  HoleFilling options;
  options.refine = false;
  const FilledMesh result = fill_holes(open.vertices, open.faces, options);
  EXPECT_TRUE(test::edge_census(result.mesh.faces).is_closed());
  EXPECT_EQ(result.mesh.vertices.size(), open.vertices.size());
  EXPECT_EQ(result.mesh.faces.size(), open.faces.size() + test::edge_census(open.faces).border - 2);
}

TEST(FillHoles, LeavesLongLoopsOpen) {
  const Mesh longer = open_cone(40), shorter = open_cone(32);
  const FilledMesh open = fill_holes(longer.vertices, longer.faces);
  EXPECT_EQ(open.filled, 0u);
  EXPECT_EQ(open.left_open, 1u);
  EXPECT_EQ(open.mesh.faces, longer.faces);
  const FilledMesh closed = fill_holes(shorter.vertices, shorter.faces);
  EXPECT_EQ(closed.filled, 1u);
  EXPECT_TRUE(test::edge_census(closed.mesh.faces).is_closed());
  // The base is flat, so any triangulation of it encloses the cone's volume.
  EXPECT_NEAR(test::enclosed_volume(closed.mesh), 16.0 * 0.25 * std::sin(2.0 * kPi / 32.0) / 3.0, 1e-6);
}

// Both diagonals of the hole are edges of other faces already: its own points cannot close it.
TEST(FillHoles, NeverMakesAnEdgeOfThreeFaces) {
  Mesh mesh = open_cone(4);  // ring 2, 3, 4, 5
  mesh.vertices.emplace_back(2.0f, 0.0f, 0.0f);
  mesh.vertices.emplace_back(0.0f, 2.0f, 0.0f);
  mesh.faces.push_back({2, 4, 6});
  mesh.faces.push_back({3, 5, 7});
  for (const bool refine : {false, true}) {
    HoleFilling options;
    options.refine = refine;
    const FilledMesh result = fill_holes(mesh.vertices, mesh.faces, options);
    EXPECT_EQ(result.filled, 1u);
    EXPECT_EQ(result.left_open, 2u);  // the two triangles that stand alone
    const test::EdgeCensus census = test::edge_census(result.mesh.faces);
    EXPECT_EQ(census.crowded, 0u);
    EXPECT_EQ(census.border, 6u);
    EXPECT_EQ(census.disagreeing, 0u);
    if (!refine) {
      EXPECT_EQ(result.mesh.vertices.size(), mesh.vertices.size() + 1);
      EXPECT_LT((result.mesh.vertices.back() - Eigen::Vector3f::Zero()).norm(), 1e-6f);
    }
  }
}

TEST(FillHoles, ClosesHolesThatTouchInAVertex) {
  Mesh mesh = icosphere(3, 0.5);
  // Two faces that share a vertex and no edge.
  const Triangle first = mesh.faces[100];
  const auto touches = [&](const Triangle& face) {
    return std::count_if(face.begin(), face.end(),
                         [&](std::int32_t v) { return std::find(first.begin(), first.end(), v) != first.end(); }) == 1;
  };
  const auto second = std::find_if(mesh.faces.begin(), mesh.faces.end(), touches);
  ASSERT_NE(second, mesh.faces.end());
  mesh.faces.erase(second);
  mesh.faces.erase(std::find(mesh.faces.begin(), mesh.faces.end(), first));
  const FilledMesh result = fill_holes(mesh.vertices, mesh.faces);
  EXPECT_EQ(result.filled, 2u);
  EXPECT_TRUE(test::edge_census(result.mesh.faces).is_closed());
  EXPECT_EQ(test::euler_characteristic(result.mesh), 2);
}

TEST(FillHoles, CountsBordersThatCannotBeClosed) {
  // Two triangles with an edge in the same direction: which side is up changes along their border.
  const FilledMesh twisted = fill_holes({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}, {{0, 1, 2}, {1, 2, 3}});
  EXPECT_EQ(twisted.filled, 0u);
  EXPECT_GT(twisted.broken, 0u);
  EXPECT_EQ(twisted.mesh.faces.size(), 2u);
  EXPECT_THROW(fill_holes({{0, 0, 0}}, {{0, 1, 2}}), InputError);
  EXPECT_TRUE(fill_holes({}, {}).mesh.faces.empty());
}

}  // namespace
}  // namespace anigen::geometry
