#include "anigen/metrics/chamfer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/geometry/bones.h"

namespace anigen::metrics {
namespace {

using Eigen::Vector3d;
using Points = std::vector<Vector3d>;

JointTree random_tree(std::uint64_t seed, std::size_t joints) {
  Rng rng(seed, "skeleton_chamfer_test");
  JointTree tree;
  for (std::size_t j = 0; j < joints; ++j) {
    tree.positions.push_back({rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5)});
    tree.parents.push_back(j == 0 ? -1 : static_cast<int>(rng.index(j)));
  }
  return tree;
}

/// All points, bone by bone; joints shared by bones are repeated, as published.
Points sample_points(const std::vector<BoneSamples>& samples) {
  Points points;
  for (const BoneSamples& bone : samples) {
    for (std::int64_t i = 0; i <= bone.last; ++i) points.push_back(bone.point(i));
  }
  return points;
}

/// By looking at every pair.
double slow_one_way(const Points& from, const Points& to) {
  double sum = 0;
  for (const Vector3d& p : from) {
    double best = std::numeric_limits<double>::infinity();
    for (const Vector3d& q : to) best = std::min(best, (p - q).norm());
    sum += best;
  }
  return sum / static_cast<double>(from.size());
}

double slow_chamfer(const Points& a, const Points& b) { return 0.5 * (slow_one_way(a, b) + slow_one_way(b, a)); }

double slow_joint_to_samples(const JointTree& a, const JointTree& b, const Points& samples_a, const Points& samples_b) {
  return 0.5 * (slow_one_way(a.positions, samples_b) + slow_one_way(b.positions, samples_a));
}

TEST(BoneSamples, SpacedSamplesIncludeBothEndsAndRoundHalfToEven) {
  const geometry::Bone line{0, 1, {0, 0, 0}, {0.02, 0, 0}};
  const Points points = sample_points(spaced_samples({line}));
  ASSERT_EQ(points.size(), 5u);  // 4 steps
  EXPECT_EQ(points.front(), line.head);
  EXPECT_NEAR((points.back() - line.tail).norm(), 0, 1e-16);
  EXPECT_NEAR(points[1].x(), 0.005, 1e-16);
  // Lengths of 0.5, 1.5 and 2.5 spacings, exact in binary: 0, 2 and 2 steps.
  const auto steps = [](double length) { return spaced_samples({{0, 1, {0, 0, 0}, {length, 0, 0}}}, 0.25)[0].last; };
  EXPECT_EQ(steps(0.125), 0);
  EXPECT_EQ(steps(0.375), 2);
  EXPECT_EQ(steps(0.625), 2);
}

TEST(BoneSamples, CountedSamplesIncludeTheChildOnly) {
  const Points points = sample_points(counted_samples({{0, 1, {0, 0, 0}, {1, 0, 0}}}, 4));
  ASSERT_EQ(points.size(), 4u);
  for (int i = 0; i < 4; ++i) EXPECT_DOUBLE_EQ(points[static_cast<std::size_t>(i)].x(), 1.0 - 0.25 * i);
}

TEST(BoneSamples, RefuseSkeletonsThatAreNotInTheUnitBox) {
  EXPECT_THROW(spaced_samples({{0, 1, {0, 0, 0}, {1e9, 0, 0}}}), InputError);
  EXPECT_THROW(spaced_samples({{0, 1, {0, 0, 0}, {1e200, 0, 0}}}), InputError);  // the length overflows
}

TEST(NearestBone, AgreesWithEverySegmentAndEverySample) {
  for (const std::size_t joints : {1u, 2u, 5u, 40u, 300u}) {
    const std::vector<geometry::Bone> lines = MetricSkeleton(random_tree(joints, joints)).bones;
    const auto spaced = spaced_samples(lines, 0.05), counted = counted_samples(lines, 7);
    const Points spaced_points = sample_points(spaced), counted_points = sample_points(counted);
    const NearestBone exact(lines), by_spacing(spaced), by_count(counted);
    Rng rng(9, "queries", joints);
    for (int i = 0; i < 200; ++i) {
      const Vector3d p(rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1));
      double segment = 1e9, near_spaced = 1e9, near_counted = 1e9;
      for (const geometry::Bone& line : lines)
        segment = std::min(segment, geometry::distance_to_segment(p, line.head, line.tail));
      for (const Vector3d& q : spaced_points) near_spaced = std::min(near_spaced, (p - q).norm());
      for (const Vector3d& q : counted_points) near_counted = std::min(near_counted, (p - q).norm());
      EXPECT_NEAR(exact.distance(p), segment, 1e-14);
      EXPECT_NEAR(by_spacing.distance(p), near_spaced, 1e-14);
      EXPECT_NEAR(by_count.distance(p), near_counted, 1e-14);
    }
  }
}

TEST(NearestBone, HandComputedDistances) {
  const NearestBone nearest(MetricSkeleton(JointTree{{{0, 0, 0}, {0, 0, 1}, {1, 0, 1}}, {-1, 0, 1}}).bones);
  EXPECT_NEAR(nearest.distance({0.5, 0, 0.5}), 0.5, 1e-12);
  EXPECT_NEAR(nearest.distance({0, 0, 2}), 1.0, 1e-12);
  EXPECT_NEAR(nearest.distance({0.3, 0.1, 0}), std::sqrt(0.1), 1e-12);
  EXPECT_THROW(NearestBone(std::vector<geometry::Bone>()), InputError);
}

TEST(SkeletonChamfer, AgreesWithHandComputedNumbers) {
  // Parallel bones of length 1, one above the other by 0.2; the second is twice as long.
  const JointTree a{{{0, 0, 0}, {1, 0, 0}}, {-1, 0}}, b{{{0, 0, 0.2}, {2, 0, 0.2}}, {-1, 0}};
  const double diagonal = std::hypot(1.0, 0.2);
  const SkeletonChamfer exact = skeleton_chamfer(a, b, SkeletonProtocol::kPaper);
  EXPECT_NEAR(exact.j2j, 0.5 * (0.5 * (0.2 + diagonal) + 0.5 * (0.2 + diagonal)), 1e-15);
  EXPECT_NEAR(exact.j2b, 0.5 * (0.2 + 0.5 * (0.2 + diagonal)), 1e-15);
  // One way 0.2 everywhere; the other way 0.2 over half of the 401 samples and then growing.
  double back = 0;
  for (int i = 0; i <= 400; ++i) back += std::hypot(std::max(0.0, 0.005 * i - 1.0), 0.2);
  EXPECT_NEAR(exact.b2b, 0.5 * (0.2 + back / 401), 1e-14);
}

TEST(SkeletonChamfer, SampledProtocolsAgreeWithExplicitSamples) {
  const JointTree a = random_tree(1, 12), b = random_tree(2, 17);
  const Points spaced_a = sample_points(spaced_samples(MetricSkeleton(a).bones)),
               spaced_b = sample_points(spaced_samples(MetricSkeleton(b).bones)),
               counted_a = sample_points(counted_samples(MetricSkeleton(a).bones)),
               counted_b = sample_points(counted_samples(MetricSkeleton(b).bones));
  const SkeletonChamfer rignet = skeleton_chamfer(a, b, SkeletonProtocol::kRignet);
  EXPECT_NEAR(rignet.j2j, slow_chamfer(a.positions, b.positions), 1e-13);
  EXPECT_NEAR(rignet.j2b, slow_joint_to_samples(a, b, spaced_a, spaced_b), 1e-13);
  EXPECT_NEAR(rignet.b2b, slow_chamfer(spaced_a, spaced_b), 1e-13);
  const SkeletonChamfer unirig = skeleton_chamfer(a, b, SkeletonProtocol::kUnirig);
  EXPECT_NEAR(unirig.j2b, slow_joint_to_samples(a, b, counted_a, counted_b), 1e-13);
  EXPECT_NEAR(unirig.b2b, slow_chamfer(counted_a, counted_b), 1e-13);
}

TEST(SkeletonChamfer, UnirigInItsOwnFrameGivesTheSameNumberAsInTheUnitBox) {
  JointTree a = random_tree(3, 9), b = random_tree(4, 11);
  const SkeletonChamfer unit = skeleton_chamfer(a, b, SkeletonProtocol::kUnirig);
  for (Vector3d& p : a.positions) p *= 2.0;
  for (Vector3d& p : b.positions) p *= 2.0;
  const SkeletonChamfer wide = skeleton_chamfer(a, b, SkeletonProtocol::kUnirig, 2.0);
  EXPECT_NEAR(unit.j2j, wide.j2j, 1e-15);
  EXPECT_NEAR(unit.b2b, wide.b2b, 1e-15);
  EXPECT_THROW(skeleton_chamfer(a, b, SkeletonProtocol::kUnirig, 0.0), InputError);
}

TEST(SkeletonChamfer, IsZeroForIdenticalSkeletonsAndSymmetric) {
  const JointTree a = random_tree(5, 40), b = random_tree(6, 25);
  for (const SkeletonProtocol protocol : kSkeletonProtocols) {
    const SkeletonChamfer self = skeleton_chamfer(a, a, protocol);
    EXPECT_LT(self.j2j, 1e-15) << name(protocol);
    EXPECT_LT(self.b2b, 1e-15) << name(protocol);
    const SkeletonChamfer there = skeleton_chamfer(a, b, protocol), back = skeleton_chamfer(b, a, protocol);
    EXPECT_DOUBLE_EQ(there.j2b, back.j2b) << name(protocol);
    EXPECT_DOUBLE_EQ(there.b2b, back.b2b) << name(protocol);
    EXPECT_GT(there.b2b, 0.01) << name(protocol);
  }
  // A joint lies on its own bone; sampled, the parent's end of a bone is missing only for UniRig.
  EXPECT_LT(skeleton_chamfer(a, a, SkeletonProtocol::kPaper).j2b, 1e-15);
  EXPECT_LT(skeleton_chamfer(a, a, SkeletonProtocol::kRignet).j2b, 1e-15);
}

TEST(SkeletonChamfer, DoesNotSeeAJointInsertedInABone) {
  // The paper's claim in section 4.1.3: bone distances stay near zero, joint distances do not.
  const JointTree truth = random_tree(7, 20);
  JointTree predicted = truth;
  const Vector3d middle = 0.5 * (truth.positions[19] + truth.positions[static_cast<std::size_t>(truth.parents[19])]);
  predicted.positions.push_back(middle);
  predicted.parents.push_back(truth.parents[19]);
  predicted.parents[19] = 20;
  const SkeletonChamfer paper = skeleton_chamfer(predicted, truth, SkeletonProtocol::kPaper);
  EXPECT_LT(paper.j2b, 1e-15);
  EXPECT_LT(paper.b2b, 1e-15);
  EXPECT_GT(paper.j2j, 1e-3);
  // Sampled conventions see it, but by no more than half a spacing.
  const SkeletonChamfer rignet = skeleton_chamfer(predicted, truth, SkeletonProtocol::kRignet);
  EXPECT_GT(rignet.b2b, 0);
  EXPECT_LT(rignet.b2b, 0.0025);
}

TEST(SkeletonChamfer, IsDefinedForDegenerateSkeletons) {
  const JointTree single{{{0.1, 0, 0}}, {-1}}, other{{{0.4, 0, 0}}, {-1}};
  const JointTree forest{{{0, 0, 0}, {0.4, 0, 0}}, {-1, -1}};
  const JointTree coincident{{{0.1, 0, 0}, {0.1, 0, 0}}, {-1, 0}};
  for (const SkeletonProtocol protocol : kSkeletonProtocols) {
    // Without bones the joints stand for them.
    EXPECT_NEAR(skeleton_chamfer(single, other, protocol).j2j, 0.3, 1e-15) << name(protocol);
    EXPECT_NEAR(skeleton_chamfer(single, other, protocol).j2b, 0.3, 1e-15) << name(protocol);
    EXPECT_NEAR(skeleton_chamfer(single, other, protocol).b2b, 0.3, 1e-15) << name(protocol);
    EXPECT_NEAR(skeleton_chamfer(other, forest, protocol).b2b, 0.5 * (0.0 + 0.5 * 0.4), 1e-15) << name(protocol);
    EXPECT_NEAR(skeleton_chamfer(coincident, other, protocol).b2b, 0.3, 1e-15) << name(protocol);
  }
  const JointTree empty, looped{{{0, 0, 0}, {1, 0, 0}}, {1, 0}};
  const JointTree broken{{{0, 0, std::nan("")}}, {-1}}, far{{{0, 0, 0}, {1e6, 0, 0}}, {-1, 0}};
  for (const JointTree* bad : {&empty, &looped, &broken, &far}) {
    EXPECT_THROW(skeleton_chamfer(*bad, single, SkeletonProtocol::kPaper), InputError);
    EXPECT_THROW(skeleton_chamfer(single, *bad, SkeletonProtocol::kPuppeteer), InputError);
  }
}

TEST(SkeletonChamfer, ProtocolsHaveNames) {
  for (const SkeletonProtocol protocol : kSkeletonProtocols)
    EXPECT_EQ(parse_skeleton_protocol(name(protocol)), protocol);
  EXPECT_THROW(parse_skeleton_protocol("Paper"), InputError);
}

}  // namespace
}  // namespace anigen::metrics
