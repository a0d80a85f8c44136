#include "anigen/asset/rigid_parts.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <limits>

#include "anigen/asset/mesh_shells.h"
#include "anigen/core/error.h"
#include "tests/support/hinged_boxes.h"

namespace anigen {
namespace {

TEST(MeshShells, BoxesOfSplitVerticesAreOneShellEach) {
  const Asset boxes = test::hinged_boxes(0.01F, 0.0F);
  const MeshShells shells = mesh_shells(boxes.mesh.vertices, boxes.mesh.faces);
  ASSERT_EQ(shells.count, 2U);
  for (std::size_t f = 0; f < 24; ++f) EXPECT_EQ(shells.of_face[f], f < 12 ? 0 : 1);
  for (std::size_t v = 0; v < 48; ++v) EXPECT_EQ(shells.of_vertex[v], v < 24 ? 0 : 1);
}

// Of boxes that lie face to face four faces meet at the edges of that face; each belongs to its box.
TEST(MeshShells, PartsThatTouchStayApart) {
  Mesh mesh;
  test::add_flat_box(mesh, {0, 0, 0}, {1, 1, 1});
  test::add_flat_box(mesh, {1, 0, 0}, {2, 1, 1});
  test::add_flat_box(mesh, {0, 1, 0}, {1, 2, 1});
  test::add_flat_box(mesh, {1, 1, 0}, {2, 2, 1});
  const MeshShells shells = mesh_shells(mesh.vertices, mesh.faces);
  EXPECT_EQ(shells.count, 4U);
  for (std::size_t f = 0; f < 48; ++f) EXPECT_EQ(shells.of_face[f], static_cast<std::int32_t>(f / 12)) << f;
}

// Three faces at an edge, or two that look the same way, tell no solid: all are one shell.
TEST(MeshShells, AnEdgeThatTellsNothingJoinsAll) {
  const std::vector<Eigen::Vector3f> places{{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {0, 0, 0}, {0, 0, 1},
                                            {0, 1, 0}, {0, 0, 0}, {0, 0, 1}, {-1, 0, 0}};
  EXPECT_EQ(mesh_shells(places, {{0, 1, 2}, {3, 4, 5}, {6, 7, 8}}).count, 1U);
}

/// Largest change of a distance between vertices of one box when the hinge turns by 45 degrees.
double bent(const Asset& boxes) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.78539816, Eigen::Vector3d::UnitY()).toRotationMatrix();
  std::vector<Eigen::Vector3d> posed;
  for (std::size_t v = 0; v < boxes.mesh.vertices.size(); ++v) {
    const Eigen::Vector3d place = boxes.mesh.vertices[v].cast<double>();
    posed.emplace_back(Eigen::Vector3d::Zero());
    for (std::size_t i = 0; i < boxes.skin.row_size(v); ++i) {
      const Influence& influence = boxes.skin.row(v)[i];
      posed.back() += static_cast<double>(influence.weight) * (influence.joint == 1 ? turn * place : place);
    }
  }
  double most = 0.0;
  for (const std::size_t first : {std::size_t{0}, std::size_t{24}}) {
    for (std::size_t a = first; a < first + 24; ++a) {
      for (std::size_t b = first; b < first + 24; ++b) {
        const double before = (boxes.mesh.vertices[a] - boxes.mesh.vertices[b]).cast<double>().norm();
        most = std::max(most, std::abs((posed[a] - posed[b]).norm() - before));
      }
    }
  }
  return most;
}

TEST(RigidParts, AHingedBoxStaysABox) {
  Asset boxes = test::hinged_boxes(0.01F, 0.3F);
  EXPECT_GT(bent(boxes), 0.05) << "bleeding weights bend it";
  RigidSkin rigid = rigid_parts(boxes.mesh, boxes.skin);
  ASSERT_EQ(rigid.parts.size(), 2U);
  for (std::size_t p = 0; p < 2; ++p) {
    EXPECT_EQ(rigid.parts[p].vertices, 24U);
    EXPECT_EQ(rigid.parts[p].joint, static_cast<std::int32_t>(p));
    // Half of the area is at the gap, with 0.3 of the other joint.
    EXPECT_NEAR(rigid.parts[p].share, 0.85, 1e-6);
    EXPECT_NEAR(rigid.parts[p].area, 0.5, 1e-6);
    EXPECT_TRUE(rigid.parts[p].rigid);
  }
  EXPECT_EQ(rigid.note(), "2 of 2 shells rigid, 100 % of the surface");
  const Json described = rigid.to_json(boxes.skeleton);
  EXPECT_EQ(described[1]["joint"], "lid");
  EXPECT_EQ(described[1]["rigid"], true);
  boxes.skin = std::move(rigid.skin);
  EXPECT_LT(bent(boxes), 1e-6);
  EXPECT_TRUE(validate(boxes).empty());
}

TEST(RigidParts, AShellOfTwoJointsKeepsItsWeights) {
  const Asset boxes = test::hinged_boxes(0.01F, 0.5F);
  const RigidSkin rigid = rigid_parts(boxes.mesh, boxes.skin, 0.8);
  EXPECT_EQ(rigid.note(), "0 of 2 shells rigid, 0 % of the surface");
  EXPECT_EQ(rigid.skin.offsets, boxes.skin.offsets);
  EXPECT_EQ(to_dense(rigid.skin, 3), to_dense(boxes.skin, 3));
}

// Weights are counted by area: triangles of one corner do not outvote the rest of a box.
TEST(RigidParts, AreaDecidesAndNotTheNumberOfVertices) {
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}};
  mesh.faces = {{0, 1, 2}, {1, 3, 2}};
  SkinWeights skin;
  for (int v = 0; v < 4; ++v) skin.append_row({{0, 1.0F}});
  for (int i = 0; i < 20; ++i) {  // a fan of slivers at a corner, all of joint 1
    mesh.vertices.emplace_back(0.0F, -0.001F * static_cast<float>(i + 1), 0.0F);
    mesh.faces.push_back({0, static_cast<std::int32_t>(mesh.vertices.size()) - 1, i == 0 ? 1 : 0});
    skin.append_row({{1, 1.0F}});
  }
  const RigidSkin rigid = rigid_parts(mesh, skin);
  ASSERT_EQ(rigid.parts.size(), 1U);
  EXPECT_EQ(rigid.parts[0].joint, 0);
  EXPECT_GT(rigid.parts[0].share, 0.99);
}

TEST(RigidParts, LooseVerticesEmptyRowsAndBadRequests) {
  Asset boxes = test::hinged_boxes(0.01F, 0.3F);
  boxes.mesh.vertices.emplace_back(9.0F, 9.0F, 9.0F);
  boxes.skin.append_row({{0, 0.5F}, {1, 0.5F}});
  const RigidSkin rigid = rigid_parts(boxes.mesh, boxes.skin);
  EXPECT_EQ(rigid.skin.row_size(48), 2U) << "a vertex without faces";
  SkinWeights empty;
  empty.offsets.assign(boxes.mesh.vertices.size() + 1, 0);
  const RigidSkin none = rigid_parts(boxes.mesh, empty);
  EXPECT_FALSE(none.parts[0].rigid);
  EXPECT_EQ(none.skin.influences.size(), 0U);
  EXPECT_THROW(rigid_parts(boxes.mesh, SkinWeights()), InputError);
  for (const double share : {0.5, 0.0, 1.1, std::numeric_limits<double>::quiet_NaN()})
    EXPECT_THROW(rigid_parts(boxes.mesh, boxes.skin, share), InputError) << share;
}

}  // namespace
}  // namespace anigen
