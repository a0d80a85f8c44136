#include "anigen/geometry/primitives.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "tests/geometry/mesh_shape.h"

namespace anigen::geometry {
namespace {

TEST(PrimitiveMeshes, AreClosedAndFaceOutwards) {
  const Mesh sphere = icosphere(3, 2.0);
  EXPECT_EQ(sphere.faces.size(), 1280u);
  EXPECT_EQ(sphere.vertices.size(), 642u);
  for (const Eigen::Vector3f& vertex : sphere.vertices) EXPECT_NEAR(vertex.norm(), 2.0f, 1e-6);
  EXPECT_TRUE(test::edge_census(sphere.faces).is_closed());
  EXPECT_NEAR(test::enclosed_volume(sphere), 4.0 / 3.0 * kPi * 8.0, 0.5);
  const Mesh solid = cone({1, 2, 3}, {2, 2, 3}, 0.5, 100);
  EXPECT_TRUE(test::edge_census(solid.faces).is_closed());
  EXPECT_NEAR(test::enclosed_volume(solid), kPi * 0.25 / 3.0, 0.001);
  EXPECT_THROW(icosphere(9, 1.0), InputError);
  EXPECT_THROW(cone({0, 0, 0}, {0, 0, 0}, 1.0, 8), InputError);
  EXPECT_THROW(cone({0, 0, 0}, {0, 0, 1}, 1.0, 2), InputError);
}

TEST(SkeletonMesh, HasASpherePerJointAndAConePerBone) {
  // Joint 3 lies on joint 2: no bone between them.
  const std::vector<Eigen::Vector3d> joints{{0, 0, 0}, {0, 0, 3}, {4, 0, 3}, {4, 0, 3}};
  const std::vector<int> parents{-1, 0, 1, 2};
  const SkeletonMesh skeleton = skeleton_mesh(joints, parents);
  EXPECT_EQ(skeleton.mesh.faces.size(), 4u * 320u + 2u * 64u);
  EXPECT_TRUE(test::edge_census(skeleton.mesh.faces).is_closed());
  // The diagonal is 5: spheres of radius 0.1 around the joints, cones of 0.05 within the skeleton's lines.
  const Box box = bounding_box(skeleton.mesh.vertices);
  EXPECT_LT((box.low - Eigen::Vector3d(-0.1, -0.1, -0.1)).norm(), 0.01);
  EXPECT_LT((box.high - Eigen::Vector3d(4.1, 0.1, 3.1)).norm(), 0.01);
  const double sphere = 4.0 / 3.0 * kPi * 1e-3, cones = kPi * 0.05 * 0.05 * (3.0 + 4.0) / 3.0;
  EXPECT_NEAR(test::enclosed_volume(skeleton.mesh), 4.0 * sphere + cones, 0.3 * sphere + 0.01 * cones);  // facets
  EXPECT_LT((skeleton.mesh.colors[0] - Eigen::Vector4f(230, 180, 80, 255) / 255.0f).norm(), 1e-6f);

  Asset asset;
  asset.mesh = skeleton.mesh;
  asset.skeleton = skeleton_from_joints(joints, parents);
  asset.skin = skeleton.skin;
  EXPECT_EQ(validate(asset), std::vector<std::string>());
  // The apex of the second bone's cone, at joint 2, moves with the parent.
  int apexes = 0;
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
    const bool is_apex =
        asset.mesh.colors[v].z() > 0.7f && (asset.mesh.vertices[v] - Eigen::Vector3f(4, 0, 3)).norm() < 1e-6f;
    if (!is_apex) continue;
    EXPECT_EQ(asset.skin.row(v)[0].joint, 1);
    ++apexes;
  }
  EXPECT_EQ(apexes, 1);
}

TEST(SkeletonMesh, OfOneJointHasUnitSize) {
  const SkeletonMesh skeleton = skeleton_mesh({{1, 1, 1}}, {-1});
  EXPECT_NEAR(bounding_box(skeleton.mesh.vertices).longest_side(), 0.04, 0.001);
  EXPECT_THROW(skeleton_mesh({}, {}), InputError);
  EXPECT_THROW(skeleton_mesh({{0, 0, 0}}, {1}), InputError);
  EXPECT_THROW(skeleton_mesh({{0, 0, 0}}, {}), InputError);
  EXPECT_THROW(skeleton_mesh({{std::numeric_limits<double>::infinity(), 0, 0}}, {-1}), InputError);
}

}  // namespace
}  // namespace anigen::geometry
