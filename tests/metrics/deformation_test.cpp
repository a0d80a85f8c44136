#include "anigen/metrics/deformation.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "tests/eval/rigged_walker.h"

namespace anigen::metrics {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;

struct Rig {
  JointTree tree;
  SkinWeights skin;
};

struct Case {
  std::vector<Vector3d> vertices;
  Rig truth;
};

/// A creature without meaning: joints anywhere, children may come before their parents.
Case random_case(std::uint64_t seed, std::size_t joints, std::size_t vertices) {
  Rng rng(seed, "deformation_test");
  Case result;
  const auto anywhere = [&] {
    return Vector3d(rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5));
  };
  for (std::size_t j = 0; j < joints; ++j) {
    result.truth.tree.positions.push_back(anywhere());
    // The last joint is the root.
    result.truth.tree.parents.push_back(j + 1 == joints ? -1 : static_cast<int>(j + 1 + rng.index(joints - 1 - j)));
  }
  for (std::size_t v = 0; v < vertices; ++v) {
    result.vertices.push_back(anywhere());
    result.truth.skin.append_row(
        {{static_cast<std::int32_t>(rng.index(joints)), static_cast<float>(rng.uniform(0.1, 1))},
         {static_cast<std::int32_t>(rng.index(joints)), static_cast<float>(rng.uniform(0.1, 1))}});
  }
  return result;
}

MatrixXd identity_plan(std::size_t n) {
  return MatrixXd::Identity(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(n)) / static_cast<double>(n);
}

DeformationError error_of(const Case& truth, const Rig& predicted, const MatrixXd& plan,
                          const DeformationOptions& options = {}) {
  return deformation_error(truth.vertices, truth.truth.tree, truth.truth.skin, predicted.tree, predicted.skin, plan,
                           options);
}

TEST(Deformation, OfIdenticalRigsIsExactlyZero) {
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    const Case rig = random_case(seed, 12, 100);
    const DeformationError error = error_of(rig, rig.truth, identity_plan(12));
    EXPECT_EQ(error.mean, 0.0);
    EXPECT_EQ(error.max, 0.0);
  }
}

TEST(Deformation, DoesNotDependOnTheNumberingOfPredictedJoints) {
  const Case truth = random_case(7, 10, 80), other = random_case(8, 10, 80);
  Rng rng(9, "plan");
  MatrixXd plan(10, 10), shuffled(10, 10);
  for (double& p : plan.reshaped()) p = rng.uniform();
  const std::vector<std::size_t> name = rng.permutation(10);
  Rig renamed = other.truth;
  for (std::size_t j = 0; j < 10; ++j) {
    shuffled.row(static_cast<Eigen::Index>(name[j])) = plan.row(static_cast<Eigen::Index>(j));
    renamed.tree.positions[name[j]] = other.truth.tree.positions[j];
    const int parent = other.truth.tree.parents[j];
    renamed.tree.parents[name[j]] = parent < 0 ? -1 : static_cast<int>(name[static_cast<std::size_t>(parent)]);
  }
  for (Influence& influence : renamed.skin.influences)
    influence.joint = static_cast<std::int32_t>(name[static_cast<std::size_t>(influence.joint)]);
  const DeformationError a = error_of(truth, other.truth, plan), b = error_of(truth, renamed, shuffled);
  EXPECT_GT(a.mean, 0.01);
  EXPECT_NEAR(a.mean, b.mean, 1e-13);
  EXPECT_NEAR(a.max, b.max, 1e-13);
}

TEST(Deformation, AgreesWithOneRotationComputedByHand) {
  // A bone from the origin to (1, 0, 0). The vertex is 0.5 from the root, and the prediction leaves it at rest by
  // giving it to a second root; the error is how far the true root's rotation takes it.
  Case truth;
  truth.vertices = {{0.5, 0, 0}};
  truth.truth.tree = {{{0, 0, 0}}, {-1}};
  truth.truth.skin.append_row({{0, 1.0f}});
  // The predicted joint sits in the vertex: it turns in place.
  Rig predicted;
  predicted.tree = {{{0.5, 0, 0}}, {-1}};
  predicted.skin = truth.truth.skin;
  DeformationOptions options;
  options.poses = 1;
  options.probability = 1.0;
  options.seed = 5;
  const DeformationError error = error_of(truth, predicted, identity_plan(1), options);
  Rng rng(5, "deformation", 0);
  rng.uniform();
  const double z = rng.uniform(-1, 1), longitude = rng.uniform(0, 2 * std::acos(-1.0));
  const double angle = rng.uniform() * std::acos(-1.0) / 6;
  // Distance of (½, 0, 0) from the axis, times the chord of the angle.
  const double along = std::sqrt(1 - z * z) * std::cos(longitude);
  const double expected = 0.5 * std::sqrt(1 - along * along) * 2 * std::sin(angle / 2);
  EXPECT_NEAR(error.mean, expected, 1e-12);
  EXPECT_NEAR(error.max, expected, 1e-12);
}

TEST(Deformation, ToleratesAJointInsertedInABone) {
  // A chain of three; the prediction has one more joint, in the middle of the last bone, that nothing is attached to
  // and that the plan gives to the bone's parent. World orientations are handed over, so nothing moves twice.
  Case truth;
  truth.truth.tree = {{{0, 0, 0}, {0.2, 0, 0}, {0.4, 0, 0}}, {-1, 0, 1}};
  for (int i = 0; i < 30; ++i) {
    truth.vertices.push_back({0.015 * i, 0.01, 0});
    truth.truth.skin.append_row({{i / 10, 1.0f}});
  }
  Rig predicted = truth.truth;
  predicted.tree.positions.push_back({0.3, 0, 0});
  predicted.tree.parents = {-1, 0, 3, 1};
  MatrixXd plan = MatrixXd::Zero(4, 3);
  plan(0, 0) = plan(1, 1) = plan(2, 2) = plan(3, 1) = 0.25;
  EXPECT_LT(error_of(truth, predicted, plan).max, 1e-15);
}

TEST(Deformation, SeesWrongWeightsAndWrongParents) {
  const Case truth = random_case(11, 12, 200);
  Rig rigid = truth.truth;
  rigid.skin = SkinWeights();
  for (std::size_t v = 0; v < truth.vertices.size(); ++v) rigid.skin.append_row({{11, 1.0f}});
  EXPECT_GT(error_of(truth, rigid, identity_plan(12)).mean, 0.01);
  Rig flat = truth.truth;
  flat.tree.parents.assign(12, -1);
  EXPECT_GT(error_of(truth, flat, identity_plan(12)).mean, 0.01);
}

TEST(Deformation, DependsOnTheSeedOnlyThroughItsPoses) {
  const Case truth = random_case(12, 8, 50), other = random_case(13, 8, 50);
  DeformationOptions options;
  options.seed = 1;
  const double first = error_of(truth, other.truth, identity_plan(8), options).mean;
  EXPECT_EQ(first, error_of(truth, other.truth, identity_plan(8), options).mean);
  options.seed = 2;
  EXPECT_NE(first, error_of(truth, other.truth, identity_plan(8), options).mean);
  // Nobody turns.
  options.probability = 0.0;
  EXPECT_LT(error_of(truth, other.truth, identity_plan(8), options).max, 1e-15);
}

TEST(Deformation, IsDefinedForForestsAndEmptyRows) {
  Case truth = random_case(14, 6, 20);
  truth.truth.tree.parents = {-1, 0, -1, 2, -1, 4};
  truth.truth.skin = SkinWeights();
  for (std::size_t v = 0; v < truth.vertices.size(); ++v) truth.truth.skin.append_row({});
  EXPECT_EQ(error_of(truth, truth.truth, identity_plan(6)).max, 0.0);
}

TEST(Deformation, RejectsBadInput) {
  const Case truth = random_case(15, 4, 10);
  const MatrixXd plan = identity_plan(4);
  EXPECT_THROW(error_of(truth, truth.truth, identity_plan(3)), InputError);
  Rig bad = truth.truth;
  bad.skin.influences[0].joint = 4;
  EXPECT_THROW(error_of(truth, bad, plan), InputError);
  bad.skin = SkinWeights();
  EXPECT_THROW(error_of(truth, bad, plan), InputError);
  bad = truth.truth;
  bad.tree.positions[0].x() = std::nan("");
  EXPECT_THROW(error_of(truth, bad, plan), InputError);
  Case none = truth;
  none.vertices.clear();
  none.truth.skin = SkinWeights();
  EXPECT_THROW(error_of(none, none.truth, plan), InputError);
  DeformationOptions options;
  options.poses = 0;
  EXPECT_THROW(error_of(truth, truth.truth, plan, options), InputError);
  options = {};
  options.probability = 1.5;
  EXPECT_THROW(error_of(truth, truth.truth, plan, options), InputError);
}

TEST(PosedPair, ShowsWhatTheErrorMeasures) {
  const io::RiggedShape truth = test::rigged_walker();
  io::RiggedShape predicted = truth;
  predicted.joints.positions[2] += Vector3d(0.05, 0, 0.1);
  const MatrixXd plan = MatrixXd::Identity(7, 7) / 7;
  const PosedPair same = posed_pair(truth, truth, plan, 0);
  EXPECT_EQ(same.truth, same.predicted);
  EXPECT_NE(same.truth, truth.mesh.vertices);
  EXPECT_NE(same.truth, posed_pair(truth, truth, plan, 1).truth);

  DeformationOptions options;
  options.poses = 1;
  options.probability = 1.0;
  std::vector<Vector3d> vertices;
  for (const Eigen::Vector3f& vertex : truth.mesh.vertices) vertices.push_back(vertex.cast<double>());
  const double error =
      deformation_error(vertices, truth.joints, truth.skin, predicted.joints, predicted.skin, plan, options).mean;
  EXPECT_GT(error, 1e-4);
  const PosedPair posed = posed_pair(truth, predicted, plan, 0, options);
  double mean = 0;
  for (std::size_t v = 0; v < vertices.size(); ++v)
    mean += (posed.truth[v] - posed.predicted[v]).cast<double>().norm() / static_cast<double>(vertices.size());
  EXPECT_NEAR(mean, error, 1e-6);  // single precision of a unit box
  EXPECT_THROW(posed_pair(truth, predicted, MatrixXd::Identity(6, 7), 0), InputError);
}

}  // namespace
}  // namespace anigen::metrics
