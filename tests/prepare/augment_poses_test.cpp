#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "anigen/asset/normalize.h"
#include "anigen/asset/skinning.h"
#include "anigen/asset/validate.h"
#include "anigen/prepare/augment/bake_pose.h"
#include "anigen/prepare/augment/pose_augmentation.h"
#include "anigen/prepare/augment/random_pose.h"
#include "anigen/prepare/creatures/creature.h"
#include "tests/prepare/augment_support.h"

namespace anigen::prepare {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

TEST(RandomPose, VerticesAndJointsFollowTheReferencesFormula) {
  const Asset asset = tube(5);
  Rng rng(3, "test");
  const JointTurns turns = draw_turns(5, 1.0, 1.0, true, rng);
  const std::vector<Eigen::Matrix4d> world = turned_joints(asset.skeleton, turns);
  // Turn after turn, from the tip to the root: what lies beyond joint k is turned about where k lies in the bind pose.
  const std::vector<Vector3d> joints = asset.skeleton.positions();
  const auto carried = [&](Vector3d point, int joint) {
    for (int k = joint; k >= 0; k = asset.skeleton.parents[static_cast<std::size_t>(k)]) {
      const auto at = static_cast<std::size_t>(k);
      point = joints[at] + turns.rotations[at] * (point - joints[at]);
    }
    return point;
  };
  for (int j = 0; j < 5; ++j) {
    EXPECT_LT(
        (world[static_cast<std::size_t>(j)].topRightCorner<3, 1>() - carried(joints[static_cast<std::size_t>(j)], j))
            .norm(),
        1e-12);
  }
  const std::vector<Vector3f> posed = skin_vertices(asset, world);
  for (std::size_t v = 0; v < posed.size(); ++v) {
    Vector3d expected = Vector3d::Zero();
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i) {
      const Influence& influence = asset.skin.row(v)[i];
      expected +=
          static_cast<double>(influence.weight) * carried(asset.mesh.vertices[v].cast<double>(), influence.joint);
    }
    EXPECT_LT((posed[v].cast<double>() - expected).norm(), 1e-6) << v;  // single precision
  }
}

TEST(RandomPose, DrawsWhatTheOptionsSay) {
  Rng rng(1, "test");
  const std::size_t count = 20000;
  const JointTurns turns = draw_turns(count, 0.8, 60.0 * kRadians, false, rng);
  EXPECT_EQ(turns.angles[0], 0.0);  // the root was to be left alone
  std::size_t turned = 0;
  double sum = 0.0, most = 0.0;
  Vector3d mean_axis = Vector3d::Zero();
  for (std::size_t j = 1; j < count; ++j) {
    const Eigen::AngleAxisd turn(turns.rotations[j]);
    EXPECT_NEAR(turn.angle(), turns.angles[j], 1e-7);
    if (turns.angles[j] == 0.0) continue;
    ++turned;
    sum += turns.angles[j];
    most = std::max(most, turns.angles[j]);
    mean_axis += turn.axis();
  }
  // Five standard deviations each.
  EXPECT_NEAR(static_cast<double>(turned) / count, 0.8, 5.0 * 0.4 / std::sqrt(count));
  EXPECT_NEAR(sum / static_cast<double>(turned) / kRadians, 30.0, 5.0 * 17.4 / std::sqrt(turned));
  EXPECT_LE(most, 60.0 * kRadians);
  EXPECT_GT(most, 59.0 * kRadians);
  EXPECT_LT(mean_axis.norm() / static_cast<double>(turned), 5.0 / std::sqrt(turned));
}

TEST(BakePose, IdentityGivesTheAssetBack) {
  for (const Asset& asset : {tube(1), tube(4), make_creature("quadruped", 5, 1)}) {
    Asset baked = bake_pose(asset, asset.skeleton.bind, skin_vertices(asset, asset.skeleton.bind));
    normalize(baked);
    for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
      EXPECT_LT((baked.mesh.vertices[v] - asset.mesh.vertices[v]).norm(), 1e-6f);
      EXPECT_LT((baked.mesh.normals[v] - asset.mesh.normals[v]).norm(), 1e-5f);
    }
    for (std::size_t j = 0; j < asset.skeleton.size(); ++j) {
      EXPECT_LT((baked.skeleton.bind[j] - asset.skeleton.bind[j]).cwiseAbs().maxCoeff(), 1e-6);
    }
    EXPECT_TRUE(baked.animations.empty());
  }
}

TEST(BakePose, NormalsTurnWithTheSurfaceAndSeamsStayShut) {
  // Two copies of one square that meet at a texture seam: the outer corners of the right one move, so the two halves of
  // the fan around a seam vertex turn differently.
  Asset asset;
  asset.mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 1, 0}};
  asset.mesh.normals.assign(8, Vector3f(0, 0, 1));
  asset.mesh.faces = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}};
  asset.skeleton = skeleton_from_joints({{0, 0, 0}, {1, 0, 0}}, {-1, 0});
  for (const int joint : {0, 0, 0, 0, 0, 1, 1, 0}) asset.skin.append_row({{joint, 1.0f}});
  JointTurns turns;
  turns.rotations = {Eigen::Matrix3d::Identity(),
                     Eigen::AngleAxisd(-EIGEN_PI / 2, Vector3d::UnitY()).toRotationMatrix()};
  turns.angles = {0.0, EIGEN_PI / 2};
  const std::vector<Eigen::Matrix4d> world = turned_joints(asset.skeleton, turns);
  const Asset baked = bake_pose(asset, world, skin_vertices(asset, world));
  EXPECT_LT((baked.mesh.vertices[5] - Vector3f(1, 0, 1)).norm(), 1e-6f);
  EXPECT_LT((baked.mesh.normals[0] - Vector3f(0, 0, 1)).norm(), 1e-6f);
  EXPECT_LT((baked.mesh.normals[5] - Vector3f(-1, 0, 0)).norm(), 1e-6f);
  EXPECT_LT((baked.mesh.normals[1] - baked.mesh.normals[4]).norm(), 1e-6f);
  EXPECT_LT((baked.mesh.normals[2] - baked.mesh.normals[7]).norm(), 1e-6f);
  EXPECT_GT(baked.mesh.normals[1].z(), 0.3f);  // between the two sides
  EXPECT_LT(baked.mesh.normals[1].x(), -0.3f);
}

TEST(BakePose, ShearedFramesBecomeRotations) {
  Asset asset = tube(3);
  // A parent stretched along one axis under a turned child: relative to it the grandchild's frame is sheared.
  std::vector<Eigen::Matrix4d> world = asset.skeleton.bind;
  world[0].topLeftCorner<3, 3>() = Vector3d(1.0, 2.0, 1.0).asDiagonal();
  world[1].topLeftCorner<3, 3>() = Eigen::AngleAxisd(0.6, Vector3d::UnitZ()).toRotationMatrix();
  const Asset baked = bake_pose(asset, world, skin_vertices(asset, world));
  EXPECT_TRUE(validate(baked).empty());
  const std::vector<Eigen::Matrix4d> rest = forward_kinematics(baked.skeleton.parents, baked.skeleton.rest);
  for (std::size_t j = 0; j < 3; ++j) {
    EXPECT_LT((rest[j] - baked.skeleton.bind[j]).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((world[j] - baked.skeleton.bind[j]).col(3).norm(), 1e-12);
  }
}

TEST(BakePose, NamesTheJointThatCollapses) {
  std::vector<Eigen::Matrix4d> world(3, Eigen::Matrix4d::Identity());
  EXPECT_FALSE(collapsed_joint(world).has_value());
  world[2](1, 1) = 0.0;
  EXPECT_EQ(collapsed_joint(world).value(), 2u);
  world[1](0, 3) = std::numeric_limits<double>::infinity();
  EXPECT_EQ(collapsed_joint(world).value(), 1u);
}

}  // namespace
}  // namespace anigen::prepare
