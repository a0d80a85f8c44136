#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/curve_skeleton/contraction.h"
#include "anigen/geometry/primitives.h"
#include "anigen/rigging/curve.h"
#include "tests/rigging/embedding_bodies.h"

namespace anigen::rigging {
namespace {

using test::Capsule;
using test::capsule_mesh;

std::vector<int> degrees_of(const Skeleton& skeleton) {
  std::vector<int> degrees(skeleton.size(), 0);
  for (std::size_t j = 1; j < skeleton.size(); ++j) {
    ++degrees[j];
    ++degrees[static_cast<std::size_t>(skeleton.parents[j])];
  }
  return degrees;
}

double nearest_joint(const Skeleton& skeleton, const Eigen::Vector3d& place) {
  double least = 1e300;
  for (const Eigen::Vector3d& joint : skeleton.positions()) least = std::min(least, (joint - place).norm());
  return least;
}

/// Mean distance to the nearest joint of the other, both ways.
double joint_distance_between(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b) {
  double sum = 0.0;
  for (const auto& [from, to] : {std::pair(a, b), std::pair(b, a)}) {
    for (const Eigen::Vector3d& p : from) {
      double least = 1e300;
      for (const Eigen::Vector3d& q : to) least = std::min(least, (p - q).norm());
      sum += 0.5 * least / static_cast<double>(from.size());
    }
  }
  return sum;
}

CurveSkeletonOptions without_cuts() {
  CurveSkeletonOptions options;
  options.longest_bone = 10.0;
  return options;
}

class CurveSkeleton : public testing::Test {
 protected:
  void SetUp() override {
    if (!curve_skeleton::can_contract()) {
      GTEST_SKIP() << "not supported: a build without CGAL (ANIGEN_WITH_CGAL)";
    }
  }
};

TEST_F(CurveSkeleton, AForkHasABranchAndThreeEnds) {
  const std::vector<Capsule> fork{
      {{0, 0, -0.4}, {0, 0, 0}, 0.06}, {{0, 0, 0}, {0.3, 0, 0.4}, 0.06}, {{0, 0, 0}, {-0.3, 0, 0.4}, 0.06}};
  const Skeleton skeleton = propose_curve_skeleton(capsule_mesh(fork), without_cuts());
  const std::vector<int> degrees = degrees_of(skeleton);
  EXPECT_EQ(std::count(degrees.begin(), degrees.end(), 3), 1);
  EXPECT_EQ(std::count(degrees.begin(), degrees.end(), 1), 3);
  EXPECT_EQ(degrees[0], 3) << "the root is the branch";
  EXPECT_LT(skeleton.positions()[0].norm(), 0.06);
  for (const Capsule& tube : fork) {
    const Eigen::Vector3d& tip = tube.a.norm() > 0.1 ? tube.a : tube.b;
    EXPECT_LT(nearest_joint(skeleton, tip), 0.06) << tip.transpose();
  }
}

TEST_F(CurveSkeleton, ABentTubeHasAJointAtTheBend) {
  const Skeleton skeleton = propose_curve_skeleton(
      capsule_mesh({{{-0.4, 0, 0}, {0, 0, 0.3}, 0.05}, {{0, 0, 0.3}, {0.4, 0, 0}, 0.05}}), without_cuts());
  const std::vector<int> degrees = degrees_of(skeleton);
  EXPECT_EQ(std::count(degrees.begin(), degrees.end(), 1), 2);
  EXPECT_EQ(*std::max_element(degrees.begin(), degrees.end()), 2);
  EXPECT_LT(nearest_joint(skeleton, {0, 0, 0.3}), 0.05);
  EXPECT_LE(skeleton.size(), 5u);
}

TEST_F(CurveSkeleton, AStraightTubeIsOneBoneOrEvenOnes) {
  const Mesh tube = capsule_mesh({{{0, 0, -0.42}, {0, 0, 0.42}, 0.08}});
  EXPECT_EQ(propose_curve_skeleton(tube, without_cuts()).size(), 2u);
  const Skeleton cut = propose_curve_skeleton(tube);
  const auto joints = cut.positions();
  for (std::size_t j = 1; j < joints.size(); ++j)
    EXPECT_LE((joints[j] - joints[static_cast<std::size_t>(cut.parents[j])]).norm(), 0.26);
  for (const Eigen::Vector3d& joint : joints) EXPECT_LT(std::hypot(joint.x(), joint.y()), 0.02);
}

TEST_F(CurveSkeleton, LimbsOfAPersonEndInJoints) {
  const Skeleton skeleton = propose_curve_skeleton(capsule_mesh(test::person()));
  for (const double side : {1.0, -1.0}) {
    EXPECT_LT(nearest_joint(skeleton, {0.46 * side, 0, 0.28}), 0.06);
    EXPECT_LT(nearest_joint(skeleton, {0.07 * side, -0.03, -0.46}), 0.08);
  }
  EXPECT_LT(nearest_joint(skeleton, {0, 0, 0.42}), 0.08);
  EXPECT_LT(skeleton.positions()[0].head<2>().norm(), 0.05) << "the root is in the trunk";
  EXPECT_EQ(std::set<std::string>(skeleton.names.begin(), skeleton.names.end()).size(), skeleton.size());
}

TEST_F(CurveSkeleton, ThereAreNoMoreJointsThanAskedFor) {
  for (const std::size_t most : {2u, 5u, 9u}) {
    CurveSkeletonOptions options;
    options.most_joints = most;
    EXPECT_LE(propose_curve_skeleton(capsule_mesh(test::person()), options).size(), most);
  }
}

TEST_F(CurveSkeleton, FollowsTheMeshAndDoesNotDependOnFaces) {
  const Mesh mesh = capsule_mesh(test::person());
  const auto plain = propose_curve_skeleton(mesh).positions();
  EXPECT_EQ(propose_curve_skeleton(mesh).positions(), plain) << "the same again";
  Mesh turned = mesh;
  for (std::size_t f = 0; f < turned.faces.size(); f += 3) std::swap(turned.faces[f][0], turned.faces[f][1]);
  const auto again = propose_curve_skeleton(turned).positions();
  EXPECT_LT(joint_distance_between(plain, again), 0.03);

  Mesh large = mesh;
  for (Eigen::Vector3f& v : large.vertices) v = 64.0F * v;
  auto scaled = propose_curve_skeleton(large).positions();
  for (Eigen::Vector3d& joint : scaled) joint /= 64.0;
  EXPECT_LT(joint_distance_between(plain, scaled), 0.03);
}

TEST_F(CurveSkeleton, PiecesAreConnectedAndDustIsLeftOut) {
  const Skeleton skeleton = propose_curve_skeleton(capsule_mesh({{{-0.3, 0, -0.4}, {-0.3, 0, 0.4}, 0.06},
                                                                 {{0.3, 0, -0.4}, {0.3, 0, 0.4}, 0.06},
                                                                 {{0, 0.4, 0}, {0, 0.4, 0}, 0.015}}),
                                                   without_cuts());
  EXPECT_EQ(std::count(skeleton.parents.begin(), skeleton.parents.end(), -1), 1);
  for (const double x : {-0.3, 0.3}) {
    for (const double z : {-0.4, 0.4}) EXPECT_LT(nearest_joint(skeleton, {x, 0, z}), 0.07);
  }
  EXPECT_GT(nearest_joint(skeleton, {0, 0.4, 0}), 0.2);
}

TEST_F(CurveSkeleton, ARingIsCutOpen) {
  std::vector<Capsule> ring;
  for (int i = 0; i < 16; ++i) {
    const auto place = [](int k) {
      return Eigen::Vector3d(0.4 * std::cos(kPi * k / 8.0), 0.4 * std::sin(kPi * k / 8.0), 0.0);
    };
    ring.push_back({place(i), place(i + 1), 0.06});
  }
  const Skeleton skeleton = propose_curve_skeleton(capsule_mesh(ring));
  EXPECT_GE(skeleton.size(), 6u);
  for (const Eigen::Vector3d& joint : skeleton.positions()) EXPECT_NEAR(joint.head<2>().norm(), 0.4, 0.06);
}

TEST_F(CurveSkeleton, AnyMeshWithExtentGivesASkeleton) {
  Mesh triangle;
  triangle.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 0, 1}};
  triangle.faces = {{0, 1, 2}};
  Mesh line = triangle;
  line.vertices[2] = {0.5F, 0, 0};
  Mesh huge = capsule_mesh(test::animal());
  for (Eigen::Vector3f& v : huge.vertices) v *= 3e37F;
  Mesh soup;
  Rng rng(9, "curve soup");
  for (std::int32_t f = 0; f < 100; ++f) {
    for (int k = 0; k < 3; ++k) {
      soup.vertices.emplace_back(static_cast<float>(rng.uniform()), static_cast<float>(rng.uniform()),
                                 static_cast<float>(rng.uniform()));
    }
    soup.faces.push_back({3 * f, 3 * f + 1, 3 * f + 2});
  }
  for (const Mesh& mesh : {triangle, line, huge, soup, geometry::icosphere(3, 1.0)}) {
    const Skeleton skeleton = propose_curve_skeleton(mesh);
    EXPECT_GE(skeleton.size(), 2u);
    EXPECT_LE(skeleton.size(), 60u);
    const Box box = bounding_box(mesh.vertices);
    for (const Eigen::Vector3d& joint : skeleton.positions()) {
      ASSERT_TRUE(joint.allFinite());
      EXPECT_LT(((joint - box.center()) / box.longest_side()).cwiseAbs().maxCoeff(), 0.55);
    }
  }
}

TEST_F(CurveSkeleton, RefusesWhatIsNoMesh) {
  EXPECT_THROW(propose_curve_skeleton(Mesh{}), InputError);
  Mesh bad = capsule_mesh(test::person());
  bad.vertices[3].z() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(propose_curve_skeleton(bad), InputError);
  CurveSkeletonOptions options;
  options.most_joints = 1;
  EXPECT_THROW(propose_curve_skeleton(capsule_mesh(test::person()), options), InputError);
}

TEST(CurveContraction, AnswersOrSaysWhichOptionIsMissing) {
  const Mesh sphere = geometry::icosphere(2, 0.5);
  std::vector<Eigen::Vector3d> vertices;
  for (const Eigen::Vector3f& v : sphere.vertices) vertices.push_back(v.cast<double>());
  if (!curve_skeleton::can_contract()) {
    EXPECT_THROW(curve_skeleton::contract_curve(vertices, sphere.faces), NotSupportedError);
    EXPECT_THROW(propose_curve_skeleton(sphere), NotSupportedError);
    return;
  }
  const curve_skeleton::CurveGraph graph = curve_skeleton::contract_curve(vertices, sphere.faces);
  ASSERT_FALSE(graph.points.empty());
  ASSERT_EQ(graph.point_of_vertex.size(), vertices.size());
  for (const int point : graph.point_of_vertex) {
    ASSERT_GE(point, 0);
    ASSERT_LT(point, static_cast<int>(graph.points.size()));
  }
}

TEST(CurveContraction, OneClosedSurfaceOnly) {
  const Mesh sphere = geometry::icosphere(1, 0.5);
  std::vector<Eigen::Vector3d> vertices;
  for (const Eigen::Vector3f& v : sphere.vertices) vertices.push_back(v.cast<double>());
  const auto refused = [&](std::vector<Triangle> faces) {
    EXPECT_THROW(
        {
          try {
            curve_skeleton::contract_curve(vertices, faces);
          } catch (const NotSupportedError&) {
          }
        },
        InputError);
  };
  std::vector<Triangle> faces = sphere.faces;
  faces.pop_back();
  refused(faces);
  faces = sphere.faces;
  std::swap(faces[4][0], faces[4][1]);
  refused(faces);
  faces = sphere.faces;
  faces.push_back(faces.front());
  refused(faces);
  refused({});
}

TEST(SolidPieces, AreClosedAndKeepTheirVolume) {
  const SolidField field = solid_field(
      capsule_mesh({{{-0.25, 0, 0}, {-0.25, 0, 0}, 0.25}, {{0.35, 0, 0}, {0.35, 0, 0}, 0.15}}, 48, 16), 1.0, 64);
  const std::vector<ClosedMesh> pieces = solid_pieces(field);
  ASSERT_EQ(pieces.size(), 2u);
  EXPECT_NEAR(pieces[0].volume, 4.0 / 3.0 * kPi * 0.25 * 0.25 * 0.25, 0.002);
  EXPECT_NEAR(pieces[1].volume, 4.0 / 3.0 * kPi * 0.15 * 0.15 * 0.15, 0.001);
  const ClosedMesh fewer = with_fewer_vertices(pieces[0], 200);
  EXPECT_LE(fewer.vertices.size(), 210u);
  EXPECT_EQ(fewer.faces.size(), 2 * fewer.vertices.size() - 4) << "a sphere stays one";
}

TEST(CurveTrees, SpursGoAndNearBranchesJoin) {
  // A line with a short spur, and two forks close to each other at its end.
  const std::vector<Eigen::Vector3d> points{{0, 0, 0},   {0, 0, 1}, {0, 0, 2},   {0.1, 0, 1},
                                            {0, 0, 2.1}, {1, 0, 2}, {1, 0, 2.1}, {-1, 0, 2.1}};
  const std::vector<double> radii(points.size(), 0.2);
  const CurveTree tree = curve_tree(points, radii, {{0, 1}, {1, 2}, {1, 3}, {2, 4}, {2, 5}, {4, 6}, {4, 7}});
  const CurveTree pruned = without_spurs(tree, 1.0, 0.0);
  EXPECT_EQ(pruned.size(), 7u);
  const CurveTree joined = with_joined_branches(pruned, 1.0);
  EXPECT_EQ(joined.size(), 6u);
  std::size_t branch = 0;
  for (int p = 0; p < static_cast<int>(joined.size()); ++p) branch = std::max(branch, joined.degree(p));
  EXPECT_EQ(branch, 4u);
  EXPECT_EQ(without_spurs(tree, 100.0, 100.0).size() >= 2, true) << "a curve is left";
}

TEST(CurveTrees, TheThinnestLinkOfACycleIsCut) {
  const CurveTree tree =
      curve_tree({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {1.0, 0.1, 1.0, 1.0}, {{0, 1}, {1, 2}, {2, 3}, {3, 0}});
  EXPECT_EQ(tree.degree(1), 1u);
  EXPECT_EQ(tree.degree(2) + tree.degree(3) + tree.degree(0), 5u);
}

}  // namespace
}  // namespace anigen::rigging
