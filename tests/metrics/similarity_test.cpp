#include "anigen/metrics/similarity.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "tests/metrics/align_shapes.h"

namespace anigen::metrics {
namespace {

double cost(const Similarity& t, const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to,
            const std::vector<double>& weights) {
  double sum = 0.0;
  for (std::size_t i = 0; i < from.size(); ++i) sum += weights[i] * (t(from[i]) - to[i]).squaredNorm();
  return sum;
}

void expect_same(const Similarity& a, const Similarity& b, double tolerance) {
  EXPECT_NEAR(a.scale, b.scale, tolerance * b.scale);
  EXPECT_LT(rotation_angle(a.rotation, b.rotation), tolerance);
  EXPECT_LT((a.translation - b.translation).norm(), tolerance);
}

TEST(Similarity, ComposesAndInverts) {
  const Similarity a = test::random_similarity(1), b = test::random_similarity(2);
  const Eigen::Vector3d p(0.3, -0.7, 0.2);
  EXPECT_LT((compose(a, b)(p) - a(b(p))).norm(), 1e-13);
  EXPECT_LT((a.inverse()(a(p)) - p).norm(), 1e-13);
  EXPECT_LT(((a.matrix() * p.homogeneous()).head<3>() - a(p)).norm(), 1e-13);
  EXPECT_LT((compose(a, a.inverse()).matrix() - Eigen::Matrix4d::Identity()).norm(), 1e-13);
}

TEST(Similarity, AngleIsExactNearZeroAndAtAHalfTurn) {
  const auto turn = [](double angle) {
    return Eigen::AngleAxisd(angle, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  };
  const Eigen::Matrix3d base = test::random_similarity(3).rotation;
  for (const double angle : {0.0, 1e-9, 0.4, 3.141592653589793})
    EXPECT_NEAR(rotation_angle(base, base * turn(angle)), angle, 1e-7 * (angle > 3) + 1e-15);
}

TEST(Similarity, MovesMeshAndJoints) {
  io::RiggedShape shape = test::rigged(test::walker(4));
  shape.mesh.normals = vertex_normals(shape.mesh.vertices, shape.mesh.faces);
  const Similarity t = test::random_similarity(4);
  const io::RiggedShape moved = transformed(t, shape);
  EXPECT_LT((moved.joints.positions[2] - t(shape.joints.positions[2])).norm(), 1e-13);
  EXPECT_LT((moved.mesh.vertices[5].cast<double>() - t(shape.mesh.vertices[5].cast<double>())).norm(), 1e-5);
  EXPECT_NEAR(moved.mesh.normals[5].norm(), 1.0f, 1e-5f);
}

TEST(Procrustes, RecoversRigidAndSimilarityExactly) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const auto from = test::random_points(seed < 10 ? 3 : 40, seed);
    for (const bool with_scale : {false, true}) {
      const Similarity truth = test::random_similarity(seed, with_scale);
      expect_same(procrustes(from, transformed(truth, from), with_scale ? PairScale::kLeastSquares : PairScale::kFixed),
                  truth, 1e-11);
    }
  }
}

TEST(Procrustes, FarFromTheOriginNothingCancels) {
  auto from = test::random_points(30, 1);
  const Similarity truth = test::random_similarity(5, false);
  auto to = transformed(truth, from);
  for (std::size_t i = 0; i < from.size(); ++i) {
    from[i] += Eigen::Vector3d(1e6, 2e6, -1e6);
    to[i] += Eigen::Vector3d(-3e6, 1e6, 1e6);
  }
  const Similarity found = procrustes(from, to, PairScale::kLeastSquares);
  EXPECT_LT(rotation_angle(found.rotation, truth.rotation), 1e-8);
  for (std::size_t i = 0; i < from.size(); ++i) EXPECT_LT((found(from[i]) - to[i]).norm(), 1e-7);
}

TEST(Procrustes, NoNearbyTransformIsBetterOnNoisyWeightedPairs) {
  Rng rng(6, "noise");
  const auto from = test::random_points(25, 6);
  auto to = transformed(test::random_similarity(6), from);
  std::vector<double> weights;
  for (Eigen::Vector3d& p : to) {
    p += 0.3 * Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal());
    weights.push_back(rng.uniform());
  }
  for (const bool with_scale : {false, true}) {
    const Similarity best = procrustes(from, to, with_scale ? PairScale::kLeastSquares : PairScale::kFixed, weights);
    EXPECT_EQ(with_scale, best.scale != 1.0);
    const double lowest = cost(best, from, to, weights);
    for (int i = 0; i < 200; ++i) {
      Similarity other = best;
      const Eigen::Vector3d axis = Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal()).normalized();
      other.rotation = Eigen::AngleAxisd(0.02 * rng.normal(), axis).toRotationMatrix() * other.rotation;
      other.translation += 0.02 * Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal());
      if (with_scale) other.scale *= std::exp(0.02 * rng.normal());
      EXPECT_GE(cost(other, from, to, weights), lowest);
    }
  }
}

TEST(Procrustes, SizeRatioIsTheSameFromEitherSide) {
  Rng rng(8, "noise");
  const auto from = test::random_points(25, 8);
  auto to = transformed(test::random_similarity(8), from);
  expect_same(procrustes(from, to, PairScale::kSizeRatio), test::random_similarity(8), 1e-11);
  for (Eigen::Vector3d& p : to) p += 0.3 * Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal());
  const double forth = procrustes(from, to, PairScale::kSizeRatio).scale;
  EXPECT_NEAR(forth * procrustes(to, from, PairScale::kSizeRatio).scale, 1.0, 1e-12);
  EXPECT_LT(procrustes(from, to, PairScale::kLeastSquares).scale, forth);  // noise shrinks the other estimate
}

TEST(Procrustes, NeverReflects) {
  const auto from = test::random_points(20, 7);
  auto to = from;
  for (Eigen::Vector3d& p : to) p.x() = -p.x();
  EXPECT_NEAR(procrustes(from, to, PairScale::kFixed).rotation.determinant(), 1.0, 1e-12);
  EXPECT_NEAR(procrustes(from, to, PairScale::kLeastSquares).rotation.determinant(), 1.0, 1e-12);
  // A flat shape is its own mirror image, so here the fit is perfect although the reflection is not allowed.
  auto flat = from;
  for (Eigen::Vector3d& p : flat) p.z() = 0.0;
  auto mirrored = flat;
  for (Eigen::Vector3d& p : mirrored) p.x() = -p.x();
  const Similarity t = procrustes(flat, mirrored, PairScale::kFixed);
  for (std::size_t i = 0; i < flat.size(); ++i) EXPECT_LT((t(flat[i]) - mirrored[i]).norm(), 1e-12);
}

TEST(Procrustes, DegeneratePairsGiveADefinedTransform) {
  const Eigen::Vector3d a(1, 2, 3), b(-4, 0, 1);
  const Similarity one = procrustes({a}, {b}, PairScale::kLeastSquares);
  EXPECT_EQ(one.scale, 1.0);
  EXPECT_LT((one.rotation - Eigen::Matrix3d::Identity()).norm(), 1e-12);
  EXPECT_LT((one(a) - b).norm(), 1e-12);
  const Similarity coincident = procrustes({a, a, a}, {b, b, b}, PairScale::kLeastSquares);
  EXPECT_LT((coincident(a) - b).norm(), 1e-12);
  EXPECT_EQ(coincident.scale, 1.0);
  // Collinear: a proper rotation that is as good as any.
  const std::vector<Eigen::Vector3d> line = {{0, 0, 0}, {1, 0, 0}, {3, 0, 0}},
                                     turned = {{0, 1, 0}, {0, 3, 0}, {0, 7, 0}};
  const Similarity collinear = procrustes(line, turned, PairScale::kLeastSquares);
  EXPECT_NEAR(collinear.rotation.determinant(), 1.0, 1e-12);
  EXPECT_NEAR(collinear.scale, 2.0, 1e-12);
  for (std::size_t i = 0; i < line.size(); ++i) EXPECT_LT((collinear(line[i]) - turned[i]).norm(), 1e-12);
}

TEST(Procrustes, RefusesBadInput) {
  const std::vector<Eigen::Vector3d> two = {{0, 0, 0}, {1, 0, 0}};
  EXPECT_THROW(procrustes({}, {}, PairScale::kFixed), InputError);
  EXPECT_THROW(procrustes(two, {{0, 0, 0}}, PairScale::kFixed), InputError);
  EXPECT_THROW(procrustes(two, two, PairScale::kFixed, {1.0}), InputError);
  EXPECT_THROW(procrustes(two, two, PairScale::kFixed, {0.0, 0.0}), InputError);
  EXPECT_THROW(procrustes(two, two, PairScale::kFixed, {1.0, -1.0}), InputError);
  EXPECT_THROW(procrustes(two, {{0, 0, 0}, {std::nan(""), 0, 0}}, PairScale::kFixed), InputError);
}

}  // namespace
}  // namespace anigen::metrics
