#include "anigen/geometry/visible_surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/primitives.h"
#include "tests/geometry/mesh_shape.h"

namespace anigen::geometry {
namespace {

Mesh sphere_at(const Eigen::Vector3f& centre, double radius, int subdivisions = 4) {
  Mesh mesh = icosphere(subdivisions, radius);
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex += centre;
  return mesh;
}

std::size_t seen_count(const Mesh& mesh) {
  const FaceMarks seen = seen_faces(mesh);
  return static_cast<std::size_t>(std::count(seen.begin(), seen.end(), 1));
}

TEST(VisibleSurface, AClosedBodyIsSeenFromOutsideWhereverItIs) {
  const Mesh sphere = sphere_at({100.0f, -7.0f, 3.0f}, 2.5);
  EXPECT_EQ(seen_count(sphere), sphere.faces.size());
  Mesh turned_inside_out = sphere;
  for (Triangle& face : turned_inside_out.faces) std::swap(face[0], face[1]);
  EXPECT_EQ(seen_count(turned_inside_out), sphere.faces.size());
}

TEST(VisibleSurface, ABodyInABodyIsNot) {
  const Mesh outer = sphere_at({0, 0, 0}, 1.0), inner = sphere_at({0.1f, 0, 0}, 0.5);
  const Mesh both = test::together(inner, outer);
  const FaceMarks seen = seen_faces(both);
  for (std::size_t f = 0; f < both.faces.size(); ++f) EXPECT_EQ(seen[f] != 0, f >= inner.faces.size()) << f;
  const Mesh visible = visible_surface(both);
  EXPECT_EQ(visible.faces.size(), outer.faces.size());
  EXPECT_EQ(visible.vertices.size(), outer.vertices.size());
}

TEST(VisibleSurface, OverlappingBodiesLoseWhatLiesInTheOther) {
  const Eigen::Vector3f step(1.2f, 0, 0);
  const Mesh both = test::together(sphere_at({0, 0, 0}, 1.0), sphere_at(step, 1.0));
  const FaceMarks seen = seen_faces(both);
  for (std::size_t f = 0; f < both.faces.size(); ++f) {
    float deepest = 2.0f, highest = 0.0f;  // distance of corners from the other body's centre
    for (const std::int32_t v : both.faces[f]) {
      const Eigen::Vector3f other = f < both.faces.size() / 2 ? step : Eigen::Vector3f(0, 0, 0);
      const float distance = (both.vertices[at(v)] - other).norm();
      deepest = std::min(deepest, distance);
      highest = std::max(highest, distance);
    }
    if (highest < 0.99f || deepest > 1.0f) {
      EXPECT_EQ(seen[f] != 0, deepest > 1.0f) << f;
    }
  }
}

TEST(VisibleSurface, TheInsideOfAnOpenBowlIsSeen) {
  Mesh bowl = sphere_at({0, 0, 0}, 1.0);
  bowl.faces.erase(std::remove_if(bowl.faces.begin(), bowl.faces.end(),
                                  [&](const Triangle& face) { return bowl.vertices[at(face[0])].z() > 0.0f; }),
                   bowl.faces.end());
  EXPECT_EQ(seen_count(bowl), bowl.faces.size());
}

TEST(VisibleSurface, NamesBadMeshesAndTakesNoFaces) {
  EXPECT_TRUE(visible_surface(Mesh()).faces.empty());
  Mesh bad = icosphere(0, 1.0);
  bad.vertices[3].y() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(visible_surface(bad), InputError);
  bad = icosphere(0, 1.0);
  bad.faces[2][1] = 99;
  EXPECT_THROW(visible_surface(bad), InputError);
}

}  // namespace
}  // namespace anigen::geometry
