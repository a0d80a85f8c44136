#include "anigen/asset/skeleton.h"

#include <gtest/gtest.h>

#include "anigen/core/random.h"

namespace anigen {
namespace {

Transform random_transform(Rng& rng) {
  Transform t;
  t.translation = {rng.normal(), rng.normal(), rng.normal()};
  t.rotation = Eigen::Quaterniond(rng.normal(), rng.normal(), rng.normal(), rng.normal()).normalized();
  t.scale = {rng.uniform(0.2, 3), rng.uniform(0.2, 3), rng.uniform(0.2, 3)};
  return t;
}

TEST(Decompose, RecoversTranslationRotationScale) {
  Rng rng(1, "decompose");
  for (int i = 0; i < 100; ++i) {
    Transform t = random_transform(rng);
    if (i % 3 == 0) t.scale.x() = -t.scale.x();
    double shear = 1.0;
    const Transform back = decompose(t.matrix(), &shear);
    EXPECT_LT((back.matrix() - t.matrix()).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_LT(shear, 1e-12);
  }
}

TEST(Decompose, ReportsShearAndSurvivesCollapse) {
  Eigen::Matrix4d sheared = Eigen::Matrix4d::Identity();
  sheared(0, 1) = 0.5;
  double shear = 0.0;
  decompose(sheared, &shear);
  EXPECT_GT(shear, 0.1);
  const Transform flat = decompose(Eigen::Vector4d(2, 0, 1, 1).asDiagonal().toDenseMatrix());
  EXPECT_TRUE(flat.matrix().allFinite());
  EXPECT_LT((flat.matrix().diagonal() - Eigen::Vector4d(2, 0, 1, 1)).norm(), 1e-12);
  EXPECT_TRUE(decompose(Eigen::Matrix4d::Zero()).matrix().allFinite());
}

TEST(ForwardKinematics, MultipliesAlongTheChain) {
  Rng rng(2, "fk");
  const Pose pose{random_transform(rng), random_transform(rng), random_transform(rng)};
  const std::vector<Eigen::Matrix4d> world = forward_kinematics({-1, 0, 0}, pose);
  EXPECT_LT((world[2] - pose[0].matrix() * pose[2].matrix()).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(BindPose, ReproducesTheBindMatrices) {
  Rng rng(3, "bind");
  Skeleton skeleton = skeleton_from_joints({{0, 0, 0}, {1, 2, 3}, {2, 2, 2}}, {-1, 0, 1});
  skeleton.bind[1].topLeftCorner<3, 3>() = random_transform(rng).rotation.toRotationMatrix();
  const std::vector<Eigen::Matrix4d> world = forward_kinematics(skeleton.parents, bind_pose(skeleton));
  for (std::size_t j = 0; j < 3; ++j) EXPECT_LT((world[j] - skeleton.bind[j]).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_EQ(skeleton.positions()[1], Eigen::Vector3d(1, 2, 3));
}

}  // namespace
}  // namespace anigen
