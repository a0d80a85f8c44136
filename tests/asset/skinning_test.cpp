#include "anigen/asset/skinning.h"

#include <gtest/gtest.h>

#include "anigen/asset/normalize.h"
#include "anigen/core/error.h"
#include "tests/asset/small_rig.h"

namespace anigen {
namespace {

TEST(SkinVertices, BindPoseGivesTheMesh) {
  const Asset asset = test::small_rig();
  const std::vector<Eigen::Vector3f> posed = skin_vertices(asset, asset.skeleton.bind);
  for (std::size_t v = 0; v < posed.size(); ++v) EXPECT_LT((posed[v] - asset.mesh.vertices[v]).norm(), 1e-6f);
}

TEST(SkinVertices, BlendsTheJointsMotions) {
  const Asset asset = test::small_rig();
  Pose pose = asset.skeleton.rest;
  pose[1].translation += Eigen::Vector3d(0, 0, 1);  // moves joint 1 and its child by (0, 0, 1)
  const std::vector<Eigen::Vector3f> posed = skin_vertices(asset, pose);
  const float expected[] = {0.0f, 0.5f, 0.75f, 1.0f};  // weight on joints 1 and 2
  for (std::size_t v = 0; v < posed.size(); ++v)
    EXPECT_NEAR(posed[v].z() - asset.mesh.vertices[v].z(), expected[v], 1e-6);
}

TEST(Normalize, FitsTheUnitBoxAndCommutesWithPosing) {
  const Asset original = test::small_rig();
  Asset asset = original;
  const Similarity applied = normalize(asset);
  const Box box = bounding_box(asset.mesh.vertices);
  EXPECT_NEAR(box.longest_side(), 1.0, 1e-6);
  EXPECT_LT(box.center().norm(), 1e-6);
  for (const double t : {0.0, 0.4, 1.3}) {
    const auto before = skin_vertices(original, sample(original.animations[0], original.skeleton, t));
    const auto after = skin_vertices(asset, sample(asset.animations[0], asset.skeleton, t));
    for (std::size_t v = 0; v < before.size(); ++v) {
      const Eigen::Vector3d expected = applied.scale * before[v].cast<double>() + applied.offset;
      EXPECT_LT((after[v].cast<double>() - expected).norm(), 1e-6);
    }
  }
}

TEST(Normalize, RefusesWhatHasNoExtent) {
  Asset asset = test::small_rig();
  for (Eigen::Vector3f& v : asset.mesh.vertices) v.setZero();
  EXPECT_THROW(normalize(asset), InputError);
  asset.mesh.vertices.clear();
  EXPECT_THROW(normalize(asset), InputError);
}

}  // namespace
}  // namespace anigen
