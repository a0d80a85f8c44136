#include "anigen/mesh_health/repair.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/primitives.h"
#include "anigen/mesh_health/carry.h"
#include "anigen/mesh_health/check.h"
#include "tests/geometry/mesh_shape.h"
#include "tests/mesh_health/shapes.h"

namespace anigen::mesh_health {
namespace {

constexpr CheckOptions kClosed{true, true};

TEST(Repair, StitchesACubeOfSeparateTriangles) {
  const Repaired repaired = repair(test::exploded(test::cube(1.0f)));
  EXPECT_EQ(repaired.mesh.vertices.size(), 8u);
  EXPECT_EQ(repaired.merged_vertices, 28u);
  EXPECT_TRUE(test::edge_census(repaired.mesh.faces).is_closed());
  EXPECT_DOUBLE_EQ(test::enclosed_volume(repaired.mesh), 1.0);
}

TEST(Repair, MergesVerticesWithinADistance) {
  Mesh mesh = test::exploded(test::cube(1.0f));
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) mesh.vertices[v].x() += 1e-5f * static_cast<float>(v % 3);
  EXPECT_FALSE(check_mesh(repair(mesh).mesh).closed);
  const Repaired repaired = repair(mesh, {1e-4, 0});
  EXPECT_EQ(check_mesh(repaired.mesh, kClosed).verdict, "sound; closed, 1 part");
}

TEST(Repair, OrientsFacesAsMostAre) {
  Mesh mesh = geometry::icosphere(2, 1.0);
  for (std::size_t f = 0; f < mesh.faces.size(); f += 3) std::swap(mesh.faces[f][1], mesh.faces[f][2]);
  const Repaired repaired = repair(mesh);
  EXPECT_TRUE(test::edge_census(repaired.mesh.faces).is_closed());
  EXPECT_GT(test::enclosed_volume(repaired.mesh), 0.0);
  // Of an open surface nothing but the majority says which side is out.
  Mesh cloth = test::cloth(4);
  std::swap(cloth.faces[0][1], cloth.faces[0][2]);
  std::swap(cloth.faces[9][1], cloth.faces[9][2]);
  const Repaired flat = repair(cloth);
  EXPECT_EQ(flat.reversed_faces, 2u);
  for (const Triangle& face : flat.mesh.faces) EXPECT_GT(face_normal(flat.mesh.vertices, face).z(), 0.9);
}

TEST(Repair, TurnsAClosedPartOutwardAndLeavesACavity) {
  Mesh inner = test::cube(1.0f, {1, 1, 1});
  for (Triangle& face : inner.faces) std::swap(face[1], face[2]);
  EXPECT_DOUBLE_EQ(test::enclosed_volume(repair(test::together(test::cube(3.0f), inner)).mesh), 26.0);
  const Repaired alone = repair(inner);
  EXPECT_EQ(alone.turned_parts, 1u);
  EXPECT_DOUBLE_EQ(test::enclosed_volume(alone.mesh), 1.0);
}

TEST(Repair, FillsAHoleUpToASize) {
  Mesh mesh = test::cube(1.0f);
  mesh.faces.resize(10);  // one side is open: a hole of four edges
  EXPECT_EQ(repair(mesh, {0.0, 3}).open_holes, 1u);
  const Repaired repaired = repair(mesh, {0.0, 4});
  EXPECT_EQ(repaired.filled_holes, 1u);
  EXPECT_EQ(check_mesh(repaired.mesh, kClosed).verdict, "sound; closed, 1 part");
  EXPECT_NEAR(test::enclosed_volume(repaired.mesh), 1.0, 1e-6);
}

TEST(Repair, PartsSolidsThatTouchSoThatWeldingKeepsThemApart) {
  for (const Eigen::Vector3f& low : {Eigen::Vector3f(1, 1, 0), Eigen::Vector3f(1, 1, 1)}) {  // by an edge, by a vertex
    const Mesh touching = test::together(test::cube(1.0f), test::cube(1.0f, low));
    EXPECT_FALSE(check_mesh(touching).manifold);
    const Repaired repaired = repair(touching);
    EXPECT_GT(repaired.copied_vertices, 0u);
    const MeshFigures after = check_mesh(repaired.mesh, {true, false});
    EXPECT_EQ(after.verdict.rfind("sound; closed, 2 parts", 0), 0u) << after.verdict;
    // Vertices move by a millionth.
    EXPECT_NEAR(after.volume, 2.0, 1e-5);
  }
}

TEST(Repair, AWallInsideASolidLeavesItClosed) {
  Mesh mesh = test::cube(1.0f);
  mesh.faces.push_back({0, 3, 7});  // along the diagonals of two sides and two edges, which get a third face each
  mesh.faces.push_back({0, 7, 4});
  const Repaired repaired = repair(mesh);
  const MeshFigures after = check_mesh(repaired.mesh, {false, false});
  EXPECT_TRUE(after.manifold);
  EXPECT_EQ(after.closed_parts, 1u);
  EXPECT_EQ(after.parts, 2u);
  EXPECT_NEAR(after.volume, 1.0, 1e-5);
}

TEST(Repair, SheetsThatCrossAtAnEdgeBecomeTwoSheets) {
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}};
  mesh.faces = {{0, 2, 1}, {0, 1, 3}, {0, 4, 1}, {0, 1, 5}};
  const Repaired repaired = repair(mesh);
  const MeshFigures after = check_mesh(repaired.mesh, {false, false});
  EXPECT_TRUE(after.manifold);
  EXPECT_EQ(after.parts, 2u);
  EXPECT_EQ(after.border_edges, 8u);
}

TEST(Repair, TakesAwayWhatHasNoArea) {
  Mesh mesh = test::cube(1.0f);
  mesh.faces.push_back({0, 0, 1});
  mesh.faces.push_back({mesh.faces[2][1], mesh.faces[2][0], mesh.faces[2][2]});
  mesh.vertices.emplace_back(9.0f, 9.0f, 9.0f);
  // A vertex in the middle of an edge, with a triangle that is a line: a T-junction that was filled.
  mesh.vertices.emplace_back(0.5f, 0.0f, 0.0f);
  const auto middle = static_cast<std::int32_t>(mesh.vertices.size()) - 1;
  for (std::size_t f = 0; f < 12; ++f) {
    if (mesh.faces[f] == Triangle{0, 3, 1}) mesh.faces[f] = {0, 3, middle};
  }
  mesh.faces.push_back({middle, 3, 1});
  mesh.faces.push_back({0, middle, 1});
  const Repaired repaired = repair(mesh);
  EXPECT_EQ(check_mesh(repaired.mesh, kClosed).verdict, "sound; closed, 1 part");
  EXPECT_EQ(repaired.isolated_vertices, 1u);
  EXPECT_EQ(repaired.duplicate_faces, 1u);
  EXPECT_EQ(repaired.degenerate_faces, 2u);
}

TEST(Repair, KeepsOneTriangleAndRefusesNumbersThatAreNone) {
  Mesh mesh = test::cloth(1);
  mesh.faces.resize(1);
  EXPECT_EQ(repair(mesh).mesh.faces.size(), 1u);
  mesh.faces[0] = {0, 0, 1};
  EXPECT_THROW(repair(mesh), Error);
  mesh = test::cube(1.0f);
  mesh.vertices[0].x() = std::numeric_limits<float>::infinity();
  EXPECT_THROW(repair(mesh), InputError);
}

/// A cube of separate triangles with texture coordinates of each corner and weights by height, one side open.
Asset rigged_cube() {
  Asset asset;
  Mesh open = test::cube(1.0f);
  open.faces.resize(10);
  asset.mesh = test::exploded(open);
  Material red, blue;
  red.name = "red";
  blue.name = "blue";
  asset.materials = {red, blue};
  for (std::size_t f = 0; f < asset.mesh.faces.size(); ++f) asset.mesh.face_materials.push_back(f < 2 ? 0 : 1);
  asset.skeleton = skeleton_from_joints({{0, 0, 0}, {0, 0, 1}}, {-1, 0});
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
    asset.mesh.uvs.emplace_back(static_cast<float>(v) / 100.0f, 0.5f);
    const float z = asset.mesh.vertices[v].z();
    asset.skin.append_row({{0, 1.0f - z}, {1, z}});
  }
  return asset;
}

TEST(CarryToRepaired, KeepsCornersMaterialsAndWeights) {
  Asset asset = rigged_cube();
  std::swap(asset.mesh.faces[3][1], asset.mesh.faces[3][2]);
  const RepairOptions options{0.0, 8};
  const CarriedAsset carried = carry_to_repaired(asset, repair(asset.mesh, options), options);
  const Mesh& mesh = carried.asset.mesh;
  EXPECT_TRUE(validate(carried.asset).empty());
  EXPECT_TRUE(carried.lost.empty());
  ASSERT_EQ(mesh.faces.size(), 12u);
  std::set<float> coordinates;
  for (const auto& uv : mesh.uvs) coordinates.insert(uv.x());
  EXPECT_EQ(coordinates.size(), 30u) << "each corner of the file keeps its own";
  EXPECT_EQ(std::count(mesh.face_materials.begin(), mesh.face_materials.end(), 0), 2);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const std::vector<float> dense = to_dense(carried.asset.skin, 2);
    EXPECT_FLOAT_EQ(dense[2 * v + 1], mesh.vertices[v].z());
  }
  EXPECT_EQ(check_mesh(mesh, kClosed).verdict, "sound; closed, 1 part");
}

TEST(CarryToRepaired, VerticesThatDifferInNothingBecomeOne) {
  Asset asset;
  asset.mesh = test::exploded(test::cube(1.0f));
  const CarriedAsset carried = carry_to_repaired(asset, repair(asset.mesh), {});
  EXPECT_EQ(carried.asset.mesh.vertices.size(), 8u);
  EXPECT_EQ(carried.asset.mesh.faces.size(), 12u);
}

TEST(CarryToNewSurface, MovesWeightsAndColoursByPlace) {
  const Asset asset = rigged_cube();
  Mesh surface = test::cloth(4);  // lies in the cube's lower side
  const CarriedAsset carried = carry_to_new_surface(asset, surface);
  EXPECT_TRUE(validate(carried.asset).empty());
  EXPECT_EQ(carried.asset.mesh.colors.size(), surface.vertices.size()) << "two materials become colours of vertices";
  EXPECT_FALSE(carried.lost.empty());
  const std::vector<float> dense = to_dense(carried.asset.skin, 2);
  for (std::size_t v = 0; v < surface.vertices.size(); ++v) EXPECT_NEAR(dense[2 * v], 1.0f, 1e-6f);
}

}  // namespace
}  // namespace anigen::mesh_health
