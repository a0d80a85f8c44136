#include "anigen/metrics/icp.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/metrics/alignment.h"
#include "anigen/metrics/similarity.h"
#include "tests/metrics/align_shapes.h"

namespace anigen::metrics {
namespace {

IcpOptions light() {
  IcpOptions options;
  options.rotations = 40;
  options.samples = 800;
  options.score_samples = 1500;
  return options;
}

AlignmentShape normalized(const Mesh& mesh, std::uint64_t seed = 0) {
  return {transformed(normalization(mesh, NormalizationMode::kCentroidRms), mesh), 1500, seed};
}

/// The figures grown fatter, another tessellation: nothing that a rigid motion can undo.
Mesh other_walker() {
  Mesh mesh = test::walker(9);
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex.x() *= 1.1f;
  return mesh;
}

TEST(RotationStarts, AreRotationsSpreadUniformly) {
  const auto rotations = random_rotations(4000, 1);
  ASSERT_EQ(rotations.size(), 4000u);
  Eigen::Matrix3d mean = Eigen::Matrix3d::Zero();
  int small = 0;
  for (const Eigen::Matrix3d& r : rotations) {
    EXPECT_LT((r * r.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_NEAR(r.determinant(), 1.0, 1e-12);
    mean += r / 4000.0;
    small += rotation_angle(r, Eigen::Matrix3d::Identity()) < 1.5707963267948966 ? 1 : 0;
  }
  EXPECT_LT(mean.cwiseAbs().maxCoeff(), 0.04);  // entries have variance 1/3: four standard errors
  // Haar measure: the share of rotations by less than a quarter turn is (π/2 − 1) / π.
  EXPECT_NEAR(small / 4000.0, (1.5707963267948966 - 1.0) / 3.141592653589793, 0.025);
  // A longer list starts with a shorter one.
  EXPECT_EQ(random_rotations(3, 1)[2], rotations[2]);
  EXPECT_NE(random_rotations(3, 2)[2], rotations[2]);
}

TEST(RotationStarts, PrincipalAxesContainTheTrueRotation) {
  const AlignmentShape shape(test::walker(8), 1000, 0);
  const Eigen::Matrix3d truth = test::random_similarity(8).rotation;
  const Eigen::Matrix3d turned = truth * shape.covariance() * truth.transpose();
  double nearest = 10.0;
  for (const Eigen::Matrix3d& r : principal_axis_rotations(shape.covariance(), turned)) {
    EXPECT_NEAR(r.determinant(), 1.0, 1e-9);
    nearest = std::min(nearest, rotation_angle(r, truth));
  }
  EXPECT_LT(nearest, 1e-6);
  EXPECT_EQ(
      principal_axis_rotations(Eigen::Vector3d(1, 2, 4).asDiagonal(), Eigen::Vector3d(4, 2, 1).asDiagonal()).size(),
      4u);
  EXPECT_EQ(principal_axis_rotations(Eigen::Matrix3d::Identity(), Eigen::Matrix3d::Identity()).size(), 24u);
  EXPECT_TRUE(principal_axis_rotations(Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Identity()).empty());
}

TEST(IcpStage, ResidualIsTheSlowObviousOne) {
  const AlignmentShape source = normalized(test::walker(7)), target = normalized(other_walker());
  const Similarity t{1.0, test::random_similarity(9).rotation, {0.1, 0.2, -0.1}};
  IcpStage stage;
  stage.samples = 300;
  const auto one_way = [](const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to) {
    double sum = 0.0;
    for (std::size_t i = 0; i < 300; ++i) {
      double best = 1e300;
      for (const Eigen::Vector3d& q : to) best = std::min(best, (from[i] - q).squaredNorm());
      sum += best / 300.0;
    }
    return sum;
  };
  const auto moved = transformed(t, source.points());
  const double slow = std::sqrt(0.5 * (one_way(moved, target.points()) + one_way(target.points(), moved)));
  EXPECT_NEAR(stage_residual(source, target, t, stage), slow, 1e-12);
  // Trimming keeps the nearest pairs, so it can only lower the residual.
  stage.trim = 0.7;
  EXPECT_LT(stage_residual(source, target, t, stage), slow);
}

TEST(IcpStage, ResidualNeverRises) {
  const AlignmentShape source = normalized(test::walker(7)), target = normalized(other_walker());
  for (const IcpVariant variant : {IcpVariant::kPointToPoint, IcpVariant::kPointToPlane}) {
    for (const IcpStage::Target where :
         {IcpStage::Target::kCoarseSamples, IcpStage::Target::kSamples, IcpStage::Target::kSurface}) {
      for (const bool similarity : {false, true}) {
        IcpStage stage;
        stage.target = where;
        stage.variant = variant;
        stage.similarity = similarity;
        stage.samples = 200;
        stage.tolerance = 0.0;
        Similarity t;
        t.rotation = random_rotations(1, 3)[0];
        double before = stage_residual(source, target, t, stage);
        for (int i = 0; i < 8; ++i) {
          stage.max_iterations = 1;
          const IcpState state = run_stage(source, target, t, stage);
          EXPECT_LE(state.residual, before * (1 + 1e-12));
          before = state.residual;
          t = state.transform;
        }
      }
    }
  }
}

TEST(Icp, RecoversARotationExactlyFromManyStarts) {
  int shape = 0;
  for (const Mesh& mesh : {test::walker(10), test::crawler(10)}) {
    for (std::uint64_t seed = 0; seed < 3; ++seed) {
      const Similarity moved_by = test::random_similarity(20 + seed);
      const Mesh moved = transformed(moved_by, mesh);
      const Similarity from = normalization(moved, NormalizationMode::kCentroidRms);
      const Similarity to = normalization(mesh, NormalizationMode::kCentroidRms);
      IcpOptions options = light();
      options.principal_axes = seed != 0;  // random rotations alone must do it, too
      options.rotations = seed != 0 ? 40 : 100;
      const IcpResult result = register_shapes(normalized(moved), normalized(mesh), options);
      const double off = test::largest_offset(compose(result.transform, from), moved, to, mesh);
      EXPECT_LT(off, 5e-6) << "shape " << shape << ", seed " << seed;  // vertices are single precision
      EXPECT_LT(result.rmse, 1e-6);
      EXPECT_GT(result.starts, options.rotations);
    }
    ++shape;
  }
}

TEST(Icp, AnotherTessellationOfTheSameShapeIsFoundBelowTheSampleSpacing) {
  const Mesh mesh = test::walker(20), coarser = transformed(test::random_similarity(31), test::walker(13));
  const Similarity truth =
      compose(normalization(mesh, NormalizationMode::kCentroidRms), test::random_similarity(31).inverse());
  const Similarity from = normalization(coarser, NormalizationMode::kCentroidRms);
  const IcpResult result = register_shapes(normalized(coarser, 1), normalized(mesh, 2), light());
  const Similarity found = compose(result.transform, from);
  EXPECT_LT(rotation_angle(found.rotation, truth.rotation), 2e-3);  // spacing of 800 samples: 0.1
}

TEST(Icp, PruningFindsWhatRefiningEveryStartFinds) {
  const std::vector<std::pair<Mesh, Mesh>> pairs = {{test::walker(8), other_walker()},
                                                    {test::crawler(8), test::walker(8)},
                                                    {test::walker(8), test::crawler(9)},
                                                    {other_walker(), test::crawler(8)}};
  IcpOptions options = light();
  options.rotations = 30;
  options.samples = 400;
  options.score_samples = 800;
  for (const auto& [source, target] : pairs) {
    const Mesh moved = transformed(test::random_similarity(40), source);
    const AlignmentShape a = normalized(moved), b = normalized(target);
    options.exhaustive = false;
    const IcpResult pruned = register_shapes(a, b, options);
    options.exhaustive = true;
    const IcpResult all = register_shapes(a, b, options);
    EXPECT_EQ(all.refined, all.starts);
    EXPECT_LE(pruned.refined, 5);
    // An equal minimum, as far as two descents stop at one point: shapes as unlike as these make it a shallow one.
    EXPECT_NEAR(pruned.rmse, all.rmse, 2e-3 * all.rmse + 1e-7);
    EXPECT_LT(rotation_angle(pruned.transform.rotation, all.transform.rotation), 0.1);
  }
}

TEST(Icp, ASymmetricShapeThatLiesRightIsNotTurned) {
  // Four equal lobes: four rotations fit, and the one that does nothing is taken.
  Mesh clover;
  for (const double side : {-1.0, 1.0}) {
    test::add_ellipsoid(clover, {side * 0.5, 0, 0}, {0.3, 0.1, 0.05}, 0, 8);
    test::add_ellipsoid(clover, {0, side * 0.5, 0}, {0.1, 0.3, 0.05}, 0, 8);
  }
  Mesh other = clover;  // the same, a little larger
  for (Eigen::Vector3f& vertex : other.vertices) vertex *= 1.02f;
  const IcpResult result = register_shapes(AlignmentShape(other, 1500, 1), AlignmentShape(clover, 1500, 2), light());
  EXPECT_EQ(result.start, 0);
  EXPECT_LT(rotation_angle(result.transform.rotation, Eigen::Matrix3d::Identity()), 0.02);
  EXPECT_LT(result.runner_up, 1.2 * result.rmse);  // the symmetry shows
  const IcpResult figure = register_shapes(normalized(test::walker(8)), normalized(test::walker(8)), light());
  EXPECT_GT(figure.runner_up, 1e-2);  // a figure has none
  EXPECT_LT(figure.rmse, 1e-9);
  EXPECT_TRUE(figure.transform.rotation.isIdentity(1e-9));
}

TEST(Icp, ScaleIsReestimatedOnlyWhenAsked) {
  const Mesh mesh = test::walker(9);
  Similarity smaller;
  smaller.scale = 0.8;
  smaller.rotation = test::random_similarity(50).rotation;
  const AlignmentShape small(transformed(smaller, mesh), 1500, 0), full(mesh, 1500, 0);
  IcpOptions options = light();
  EXPECT_EQ(register_shapes(small, full, options).transform.scale, 1.0);
  for (const IcpVariant variant : {IcpVariant::kPointToPoint, IcpVariant::kPointToPlane}) {
    options.similarity = true;
    options.variant = variant;
    const IcpResult result = register_shapes(small, full, options);
    EXPECT_NEAR(result.transform.scale, 1.25, 1e-5);
    EXPECT_LT(test::largest_offset(compose(result.transform, smaller), mesh, {}, mesh), 1e-5);
  }
}

TEST(Icp, TrimmingIgnoresAPartThatOnlyOneShapeHas) {
  Mesh with_wing = test::walker(10);
  test::add_ellipsoid(with_wing, {0.5, 0.5, 0.3}, {0.15, 0.15, 0.15}, 0, 8);
  const AlignmentShape target(with_wing, 2500, 0);
  const AlignmentShape source(
      transformed({1.0, test::random_similarity(60).rotation, Eigen::Vector3d::Zero()}, test::walker(10)), 2500, 0);
  IcpOptions options = light();
  options.trim = 0.6;
  const Similarity found = compose(register_shapes(source, target, options).transform,
                                   {1.0, test::random_similarity(60).rotation, Eigen::Vector3d::Zero()});
  const Mesh mesh = test::walker(10);
  EXPECT_LT(test::largest_offset(found, mesh, {}, mesh), 1e-4);
  options.trim = 1.0;
  const Similarity pulled = compose(register_shapes(source, target, options).transform,
                                    {1.0, test::random_similarity(60).rotation, Eigen::Vector3d::Zero()});
  EXPECT_GT(test::largest_offset(pulled, mesh, {}, mesh), 1e-2);
}

TEST(Icp, DoesNotDependOnThreads) {
  const AlignmentShape a = normalized(transformed(test::random_similarity(70), test::walker(7)));
  const AlignmentShape b = normalized(other_walker());
  IcpOptions options = light();
  const IcpResult one = register_shapes(a, b, options);
  options.parallel = true;
  const int before = thread_count();
  set_thread_count(3);
  const IcpResult three = register_shapes(a, b, options);
  set_thread_count(before);
  EXPECT_EQ(one.rmse, three.rmse);
  EXPECT_EQ(one.start, three.start);
  EXPECT_EQ(one.transform.matrix(), three.transform.matrix());
}

TEST(Icp, BarePointSetsAlignToo) {
  const auto points = test::random_points(30, 80);
  const Similarity moved_by = test::random_similarity(80, false);
  const AlignmentShape source(transformed(moved_by, points), 1000, 0), target(points, 1000, 0);
  const Similarity found = compose(register_shapes(source, target, {}).transform, moved_by);
  for (const Eigen::Vector3d& p : points) EXPECT_LT((found(p) - p).norm(), 1e-9);
}

TEST(Icp, DegenerateShapesGiveADefinedResult) {
  const AlignmentShape point({{1, 2, 3}}, 10, 0), line({{0, 0, 0}, {0, 1, 0}, {0, 3, 0}}, 10, 0);
  const IcpResult points = register_shapes(point, point, light());
  EXPECT_EQ(points.rmse, 0.0);
  const IcpResult mixed = register_shapes(point, line, light());
  EXPECT_TRUE(mixed.transform.matrix().allFinite());
  EXPECT_TRUE(std::isfinite(mixed.rmse));
  const AlignmentShape turned({{0, 0, 0}, {1, 0, 0}, {3, 0, 0}}, 10, 0);
  EXPECT_LT(register_shapes(turned, line, light()).rmse, 1e-6);  // both directions of the line count as equally good
  Mesh needle;
  needle.vertices = {{0, 0, 0}, {1, 0, 0}, {3, 0, 0}};
  needle.faces = {{0, 1, 2}};
  const IcpResult flat = register_shapes(AlignmentShape(needle, 100, 0), line, light());
  EXPECT_TRUE(std::isfinite(flat.rmse));
}

TEST(Icp, RefusesBadInput) {
  EXPECT_THROW(AlignmentShape(Mesh{}, 10, 0), InputError);
  EXPECT_THROW(AlignmentShape(std::vector<Eigen::Vector3d>{}, 10, 0), InputError);
  EXPECT_THROW(AlignmentShape(test::walker(4), 0, 0), InputError);
  EXPECT_THROW(AlignmentShape({{NAN, 0, 0}}, 10, 0), InputError);
  Mesh broken = test::walker(4);
  broken.vertices[3].x() = INFINITY;
  EXPECT_THROW(AlignmentShape(broken, 10, 0), InputError);
  IcpOptions options;
  options.trim = 0.0;
  EXPECT_THROW(check(options), InputError);
  options = {};
  options.rotations = -1;
  EXPECT_THROW(check(options), InputError);
  options = {};
  options.samples = 0;
  EXPECT_THROW(check(options), InputError);
  EXPECT_NO_THROW(check(IcpOptions{}));
}

TEST(PlainIcp, OneIterationIsProcrustesOnNearestPoints) {
  const auto source = test::random_points(20, 90), target = test::random_points(25, 91);
  const auto nearest = [&](const Eigen::Vector3d& p) {
    return *std::min_element(target.begin(), target.end(), [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
      return (a - p).squaredNorm() < (b - p).squaredNorm();
    });
  };
  std::vector<Eigen::Vector3d> goals;
  for (const Eigen::Vector3d& p : source) goals.push_back(nearest(p));
  const IcpState state = plain_icp(source, nearest, {}, 1, 0.0);
  EXPECT_EQ(state.iterations, 1);
  EXPECT_LT((state.transform.matrix() - procrustes(source, goals, PairScale::kFixed).matrix()).norm(), 1e-12);
  EXPECT_EQ(plain_icp(source, nearest, {}, 0, 0.0).iterations, 0);
  EXPECT_THROW(plain_icp({}, nearest, {}, 5, 0.0), InputError);
}

}  // namespace
}  // namespace anigen::metrics
