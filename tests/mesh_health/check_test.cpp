#include "anigen/mesh_health/check.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/text.h"
#include "anigen/geometry/primitives.h"
#include "tests/geometry/mesh_shape.h"
#include "tests/mesh_health/shapes.h"

namespace anigen::mesh_health {
namespace {

std::string codes(const MeshFigures& figures) {
  return joined(figures.findings, ",", [](const MeshFinding& finding) { return finding.code; });
}

TEST(CheckMesh, ACubeIsSoundClosedAndMeasured) {
  const MeshFigures figures = check_mesh(test::cube(2.0f, {1, 1, 1}), {true, true});
  EXPECT_EQ(codes(figures), "");
  EXPECT_EQ(figures.verdict, "sound; closed, 1 part");
  EXPECT_TRUE(figures.closed && figures.manifold && figures.oriented);
  EXPECT_DOUBLE_EQ(figures.area, 24.0);
  EXPECT_DOUBLE_EQ(figures.volume, 8.0);
  EXPECT_EQ(figures.box.low, Eigen::Vector3d(1, 1, 1));
  EXPECT_EQ(figures.box.high, Eigen::Vector3d(3, 3, 3));
}

TEST(CheckMesh, VerticesAtOnePositionAreOnePlace) {
  const MeshFigures figures = check_mesh(test::exploded(test::cube(1.0f)), {true, true});
  EXPECT_EQ(codes(figures), "");
  EXPECT_EQ(figures.vertices, 36u);
  EXPECT_EQ(figures.places, 8u);
}

TEST(CheckMesh, AnOpenClothIsSoundUnlessItShallBeASolid) {
  const Mesh cloth = test::cloth(4);
  const MeshFigures figures = check_mesh(cloth);
  EXPECT_EQ(figures.verdict, "sound; open, 1 part, 1 border");
  EXPECT_EQ(figures.border_edges, 16u);
  EXPECT_EQ(figures.closed_parts, 0u);
  EXPECT_EQ(codes(check_mesh(cloth, {true, true})), "open-borders");
}

TEST(CheckMesh, OneTriangleIsOpen) {
  Mesh mesh = test::cloth(1);
  mesh.faces.resize(1);
  const MeshFigures figures = check_mesh(mesh);
  EXPECT_EQ(codes(figures), "isolated-vertices");
  EXPECT_EQ(figures.border_edges, 3u);
  EXPECT_DOUBLE_EQ(figures.area, 0.5);
}

TEST(CheckMesh, EachDefectIsFoundAlone) {
  const auto found = [](const Mesh& mesh) { return codes(check_mesh(mesh)); };
  Mesh flipped = test::cube(1.0f);
  std::swap(flipped.faces[4][1], flipped.faces[4][2]);
  EXPECT_EQ(found(flipped), "misoriented-edges");
  Mesh inverted = test::cube(1.0f);
  for (Triangle& face : inverted.faces) std::swap(face[1], face[2]);
  EXPECT_EQ(found(inverted), "inverted-parts");
  Mesh twice = test::cube(1.0f);
  twice.faces.push_back({twice.faces[0][1], twice.faces[0][0], twice.faces[0][2]});
  EXPECT_EQ(found(twice), "duplicate-faces");
  Mesh collapsed = test::cube(1.0f);
  collapsed.faces.push_back({0, 0, 1});
  EXPECT_EQ(found(collapsed), "degenerate-faces");
  Mesh sliver = test::cloth(2);  // a fin without area on the border's vertices 0, 1, 2
  sliver.faces.push_back({0, 2, 1});
  EXPECT_EQ(found(sliver), "degenerate-faces");
  Mesh fin = test::cloth(1);
  fin.vertices.emplace_back(0.5f, 0.5f, 1.0f);
  fin.faces.push_back({0, 3, 4});
  EXPECT_EQ(found(fin), "non-manifold-edges");
  const Mesh touching = test::together(test::cube(1.0f), test::cube(1.0f, {1, 1, 1}));
  EXPECT_EQ(found(touching), "non-manifold-vertices");
  const Mesh crossing = test::together(test::cube(1.0f), test::cube(1.0f, {0.5f, 0.25f, 0.125f}));
  EXPECT_EQ(codes(check_mesh(crossing, {true, true})), "part-intersections");
  EXPECT_EQ(found(crossing), "") << "clothes and eyes cross the body, too";
  EXPECT_NE(check_mesh(crossing).verdict.find("faces cross other parts"), std::string::npos);
}

TEST(CheckMesh, ACavityIsNotInsideOut) {
  Mesh inner = test::cube(1.0f, {1, 1, 1});
  for (Triangle& face : inner.faces) std::swap(face[1], face[2]);
  const MeshFigures figures = check_mesh(test::together(test::cube(3.0f), inner));
  EXPECT_EQ(codes(figures), "");
  EXPECT_DOUBLE_EQ(figures.volume, 26.0);
}

TEST(CheckMesh, APartThatFoldsThroughItselfIsToldFromTwoParts) {
  // A strip of two cells whose last edge is bent down through the first cell.
  Mesh strip;
  strip.vertices = {{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {1, 1, 0}, {0.5f, 0.25f, 1}, {0.5f, 0.75f, 1}, {0.25f, 0.25f, -1}};
  strip.faces = {{0, 2, 1}, {1, 2, 3}, {2, 4, 3}, {3, 4, 5}, {4, 6, 5}};
  const MeshFigures figures = check_mesh(strip);
  EXPECT_EQ(codes(figures), "self-intersections");
  EXPECT_GE(figures.crossed_faces, 2u);
  EXPECT_EQ(figures.crossed_parts_faces, 0u);
}

TEST(CheckMesh, TwoBodiesInOneFileAreTwoParts) {
  const MeshFigures figures = check_mesh(test::together(test::cube(1.0f), test::cube(2.0f, {5, 0, 0})));
  EXPECT_EQ(figures.parts, 2u);
  EXPECT_EQ(figures.closed_parts, 2u);
  EXPECT_DOUBLE_EQ(figures.volume, 9.0);
}

TEST(CheckMesh, RefusesWhatIsNoSurface) {
  Mesh mesh = test::cube(1.0f);
  mesh.vertices[3].y() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(check_mesh(mesh), InputError);
  mesh = test::cube(1.0f);
  mesh.faces[5][2] = 8;
  EXPECT_THROW(check_mesh(mesh), InputError);
  mesh.faces.clear();
  EXPECT_THROW(check_mesh(mesh), InputError);
}

TEST(CheckMesh, ALargeSphereHasNoFalseCrossings) {
  const Mesh sphere = geometry::icosphere(6, 0.5);  // 81,920 faces
  const MeshFigures figures = check_mesh(sphere, {true, true});
  EXPECT_EQ(codes(figures), "");
  // A sphere of radius 1/2 has the volume π/6; edges of 1/100 leave a thousandth of it out.
  EXPECT_NEAR(figures.volume, 0.5235988, 5e-4);
}

TEST(CheckMesh, JsonHoldsTheFindings) {
  Mesh mesh = test::cube(1.0f);
  mesh.faces.push_back({0, 0, 1});
  const Json json = to_json(check_mesh(mesh));
  EXPECT_EQ(json.at("findings").dump(), R"([{"code":"degenerate-faces","count":1}])");
  EXPECT_EQ(json.at("faces"), 13);
  EXPECT_EQ(json.at("closed"), true);
  EXPECT_FALSE(to_json(check_mesh(mesh, {false, false})).contains("crossings"));
}

}  // namespace
}  // namespace anigen::mesh_health
