#include <gtest/gtest.h>
#include <cmath>
#include <limits>
#include <set>

#include "anigen/asset/skeleton.h"
#include "anigen/core/error.h"
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

TEST(SkeletonFromJoints, HasANamePerJoint) {
  const std::vector<Eigen::Vector3d> places = {{0, 0, 0}, {1, 2, 3}, {2, 2, 2}};
  EXPECT_EQ(skeleton_from_joints(places, {-1, 0, 1}).names[2], "joint_2");
  EXPECT_EQ(skeleton_from_joints(places, {-1, 0, 1}, {"a", "b", "c"}).names[2], "c");
  for (const std::size_t count : {1, 2, 4}) {
    try {
      skeleton_from_joints(places, {-1, 0, 1}, std::vector<std::string>(count, "a"));
      ADD_FAILURE() << count << " names";
    } catch (const InputError& error) {
      EXPECT_EQ(error.place(), "names");
      EXPECT_NE(error.problem().find(std::to_string(count) + " for 3 joints"), std::string::npos) << error.what();
    }
  }
}

}  // namespace

namespace {

using Names = std::vector<std::string>;

/// A body along z, two arms, two legs, a tail to the back.
struct Biped {
  std::vector<Eigen::Vector3d> positions = {{0, 0, 1},         {0, 0, 1.5},     {0, 0, 2},  // spine
                                            {0.3, 0, 1.5},     {0.8, 0, 1.5},               // left arm, of 1
                                            {-0.3, 0.01, 1.5}, {-0.8, 0, 1.48},             // right arm, of 1
                                            {0.2, 0, 0.5},     {0.2, 0, -0.6},              // left leg, of 0
                                            {-0.2, 0, 0.5},    {-0.2, 0, -0.6},             // right leg, of 0
                                            {0, 0.3, 1},       {0.6, -0.2, 1.5}};           // tail; left thumb, of 3
  std::vector<int> parents = {-1, 0, 1, 1, 3, 1, 5, 0, 7, 0, 9, 0, 3};
};

TEST(JointNames, TellChainAndSide) {
  const Biped biped;
  // The legs lead farther than the spine, but they are two; the arms begin at the spine; the right hand has no thumb.
  EXPECT_EQ(
      joint_names(biped.positions, biped.parents),
      (Names{"chain_0_00", "chain_0_01", "chain_0_02", "chain_2_00_L", "chain_2_01_L", "chain_2_00_R", "chain_2_01_R",
             "chain_1_00_L", "chain_1_01_L", "chain_1_00_R", "chain_1_01_R", "chain_3_00", "chain_4_00"}));
}

TEST(JointNames, WithoutAMirrorImageTheLongestWayGoesOn) {
  const std::vector<Eigen::Vector3d> positions = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {2, 0, 0}, {0, 0, 1.5}};
  EXPECT_EQ(joint_names(positions, {-1, 0, 0, 2, 1}),
            (Names{"chain_0_00", "chain_1_00", "chain_0_01", "chain_0_02", "chain_1_01"}));
}

TEST(MirroredJoints, AreThoseOfOneNameButForTheSide) {
  const Biped biped;
  EXPECT_EQ(mirrored_joints(biped.positions, biped.parents),
            (std::vector<int>{-1, -1, -1, 5, 6, 3, 4, 9, 10, 7, 8, -1, -1}));
  EXPECT_TRUE(mirrored_joints({}, {}).empty());
}

TEST(JointNames, SmallMovementsKeepThem) {
  Biped biped;
  const Names names = joint_names(biped.positions, biped.parents);
  for (std::size_t j = 0; j < biped.positions.size(); ++j) biped.positions[j].y() += 0.01 * static_cast<double>(j % 3);
  EXPECT_EQ(joint_names(biped.positions, biped.parents), names);
}

TEST(JointNames, WithoutExtentByIndex) {
  EXPECT_EQ(joint_names({{1, 1, 1}}, {-1}), Names{"joint_000"});
  EXPECT_EQ(joint_names({{1, 1, 1}, {1, 1, 1}}, {-1, 0}), (Names{"joint_000", "joint_001"}));
  EXPECT_TRUE(joint_names({}, {}).empty());
}

TEST(JointNames, RefuseWhatIsNoTree) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(joint_names({{0, 0, 0}, {1, 0, 0}}, {-1}), InputError);
  EXPECT_THROW(joint_names({{0, 0, 0}, {1, 0, 0}}, {-1, 1}), InputError);
  EXPECT_THROW(joint_names({{0, 0, 0}, {nan, 0, 0}}, {-1, 0}), InputError);
}

}  // namespace

namespace {

using Parents = std::vector<int>;

/// One root and no cycle.
bool is_tree(const Parents& parents) {
  int roots = 0;
  for (std::size_t j = 0; j < parents.size(); ++j) {
    roots += parents[j] < 0 ? 1 : 0;
    int joint = static_cast<int>(j);
    for (std::size_t steps = 0; joint >= 0; ++steps) {
      if (steps > parents.size()) return false;
      joint = parents[static_cast<std::size_t>(joint)];
    }
  }
  return roots == 1;
}

double likelihood_of(const Parents& parents, const Eigen::MatrixXd& log_likelihood) {
  double sum = 0.0;
  for (int j = 0; j < log_likelihood.rows(); ++j) {
    const int parent = parents[static_cast<std::size_t>(j)];
    sum += log_likelihood(j, parent < 0 ? j : parent);
  }
  return sum;
}

/// Of all ways to choose parents.
double best_of_all(const Eigen::MatrixXd& log_likelihood) {
  const auto count = static_cast<int>(log_likelihood.rows());
  double best = -std::numeric_limits<double>::infinity();
  const auto ways = static_cast<int>(std::lround(std::pow(count, count)));
  for (int way = 0; way < ways; ++way) {
    Parents parents;
    for (int j = 0, rest = way; j < count; ++j, rest /= count) parents.push_back(rest % count == j ? -1 : rest % count);
    if (is_tree(parents)) best = std::max(best, likelihood_of(parents, log_likelihood));
  }
  return best;
}

TEST(LikeliestTree, IsTheBestOfAllTrees) {
  for (std::uint64_t index = 0; index < 60; ++index) {
    Rng rng(3, "spanning trees", index);
    const auto count = static_cast<Eigen::Index>(1 + rng.index(5));
    Eigen::MatrixXd log_likelihood(count, count);
    for (double& entry : log_likelihood.reshaped()) entry = 20.0 * rng.normal();
    const Parents parents = likeliest_tree(log_likelihood);
    ASSERT_TRUE(is_tree(parents)) << index;
    EXPECT_NEAR(likelihood_of(parents, log_likelihood), best_of_all(log_likelihood), 1e-9) << index;
  }
}

TEST(LikeliestTree, KeepsATreeThatIsThere) {
  Eigen::MatrixXd log_likelihood = Eigen::MatrixXd::Constant(4, 4, -3.0);
  log_likelihood(3, 3) = log_likelihood(0, 3) = log_likelihood(1, 0) = log_likelihood(2, 0) = -0.1;
  log_likelihood(2, 2) = -0.2;  // nearly a root, too
  EXPECT_EQ(likeliest_tree(log_likelihood), (Parents{3, 0, 0, -1}));
}

TEST(LikeliestTree, OpensACycleWhereItCostsLeast) {
  // 0 and 1 want each other, 2 wants 1; to be the root costs 0 nine, 1 three, 2 eight.
  Eigen::MatrixXd log_likelihood = Eigen::MatrixXd::Constant(3, 3, -10.0);
  log_likelihood(0, 1) = log_likelihood(1, 0) = log_likelihood(2, 1) = 0.0;
  log_likelihood.diagonal() << -9.0, -3.0, -8.0;
  EXPECT_EQ(likeliest_tree(log_likelihood), (Parents{1, -1, 1}));
}

TEST(LikeliestTree, LeavesOneOfSeveralRoots) {
  // Everyone wants to be a root; 1 minds least to hang on 2.
  Eigen::MatrixXd log_likelihood = Eigen::MatrixXd::Constant(3, 3, -50.0);
  log_likelihood.diagonal().setZero();
  log_likelihood(1, 2) = -1.0;
  log_likelihood(0, 1) = -2.0;
  EXPECT_EQ(likeliest_tree(log_likelihood), (Parents{1, 2, -1}));
}

TEST(LikeliestTree, SmallAndWrongInputs) {
  EXPECT_EQ(likeliest_tree(Eigen::MatrixXd::Constant(1, 1, -7.0)), Parents{-1});
  EXPECT_TRUE(likeliest_tree(Eigen::MatrixXd(0, 0)).empty());
  EXPECT_TRUE(is_tree(likeliest_tree(Eigen::MatrixXd::Zero(40, 40)))) << "all alike";
  EXPECT_THROW(likeliest_tree(Eigen::MatrixXd::Zero(2, 3)), InputError);
  EXPECT_THROW(likeliest_tree(Eigen::MatrixXd::Constant(2, 2, std::nan(""))), InputError);
}

TEST(ShortestTree, GoesFromPointToPointAndHangsAtTheMiddle) {
  const std::vector<Eigen::Vector3d> points = {{4, 0, 0}, {0, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 0, 0}};
  EXPECT_EQ(shortest_tree(points), (Parents{2, 4, -1, 2, 2}));
  EXPECT_TRUE(shortest_tree({}).empty());
  EXPECT_EQ(shortest_tree({{1, 2, 3}}), Parents{-1});
  EXPECT_EQ(shortest_tree({{1, 2, 3}, {1, 2, 3}}), (Parents{-1, 0}));
  EXPECT_THROW(shortest_tree({{0, 0, std::nan("")}}), InputError);
}

TEST(TreeSignature, IsThatOfTheTreeWhateverTheOrderOfItsJoints) {
  const std::vector<int> limb = {-1, 0, 1, 0, 3, 4};  // chains of two and of three joints
  EXPECT_EQ(tree_signature(limb).size(), 32U);
  EXPECT_EQ(tree_signature({-1, 0, 1, 2, 0, 4}), tree_signature(limb)) << "children the other way round";
  EXPECT_EQ(tree_signature({1, 2, 5, 4, 5, -1}), tree_signature(limb)) << "children before parents";
  EXPECT_NE(tree_signature({-1, 0, 1, 2, 3, 4}), tree_signature(limb));
  EXPECT_NE(tree_signature({-1, 0, 1, -1, 3, 4}), tree_signature(limb)) << "two trees";
  EXPECT_EQ(tree_signature({-1, 0, -1, 2, 3}), tree_signature({-1, 0, 1, -1, 3}));
  EXPECT_TRUE(tree_signature({}).empty());
}

}  // namespace

}  // namespace anigen
