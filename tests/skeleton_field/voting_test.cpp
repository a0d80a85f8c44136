#include "anigen/skeleton_field/voting.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/nearest_point.h"
#include "tests/skeleton_field/drawn_votes.h"
#include "tests/skeleton_field/plain_vote_clustering.h"

namespace anigen::skeleton_field {
namespace {

using test::drawn_votes;
using Plain = test::PlainVoteClustering;

/// Bit for bit: floats compare equal.
void expect_same(const GroupedSkeleton& found, const GroupedSkeleton& expected, const std::string& what) {
  ASSERT_EQ(found.joints.size(), expected.joints.size()) << what;
  ASSERT_EQ(found.parents, expected.parents) << what;
  for (std::size_t j = 0; j < found.joints.size(); ++j)
    ASSERT_EQ(found.joints[j], expected.joints[j]) << what << ", joint " << j;
}

std::string place_of_error(const Votes& votes) {
  try {
    mean_shift_grouping(votes);
  } catch (const InputError& error) {
    return error.place();
  }
  return "";
}

TEST(VoteClustering, EqualsComparingAllPairsBitForBit) {
  for (const std::size_t count : {2u, 40u, 700u, 1500u}) {
    for (const double deviation : {0.0, 0.002, 0.006, 0.1}) {
      const Votes votes = drawn_votes(count, 12, deviation, count);
      const std::string what = std::to_string(count) + " votes, deviation " + std::to_string(deviation);
      expect_same(mean_shift_grouping(votes), Plain::mean_shift(votes, {}), what);
      expect_same(threshold_grouping(votes), Plain::threshold(votes, {}), what + ", threshold");
      MeanShiftOptions options;
      options.bandwidth = 0.03F;
      options.max_neighbours = 5;
      options.min_cluster_size = 0;
      options.confidence_threshold = 0.4F;
      expect_same(mean_shift_grouping(votes, options), Plain::mean_shift(votes, options), what + ", other options");
    }
  }
}

// Distances that are exactly the radius, or the last float below it, are where a grid of cells would go wrong.
TEST(VoteClustering, EqualsComparingAllPairsOnALatticeOfTheBandwidth) {
  MeanShiftOptions options;
  options.bandwidth = 0.25F;  // exact, so that neighbours lie exactly on the radius
  options.min_cluster_size = 0;
  Rng rng(3, "lattice");
  for (const float offset : {0.0F, -1e-7F, 1e-7F}) {
    Votes votes;
    for (int i = 0; i < 600; ++i) {
      Eigen::Vector3f vote;
      for (float& x : vote) {
        x = 0.125F * static_cast<float>(rng.index(9)) - 0.5F;
        if (rng.chance(0.5)) x *= 1.0F + offset;
      }
      votes.joints.push_back(vote);
      votes.parents.push_back(-vote);
    }
    expect_same(mean_shift_grouping(votes, options), Plain::mean_shift(votes, options), std::to_string(offset));
    ThresholdOptions threshold;
    threshold.distance = 0.125F;
    threshold.max_neighbours = 3;
    expect_same(threshold_grouping(votes, threshold), Plain::threshold(votes, threshold), std::to_string(offset));
  }
}

TEST(VoteClustering, DoesNotDependOnThreads) {
  const Votes votes = drawn_votes(6000, 30, 0.005, 7);
  const int threads = thread_count();
  set_thread_count(1);
  const GroupedSkeleton one = mean_shift_grouping(votes), one_threshold = threshold_grouping(votes);
  set_thread_count(4);
  expect_same(mean_shift_grouping(votes), one, "mean shift");
  expect_same(threshold_grouping(votes), one_threshold, "threshold");
  set_thread_count(threads);
}

TEST(VoteClustering, FindsJointsAndParentsOfAChain) {
  const std::vector<Eigen::Vector3f> places = {{0, 0, -0.3F}, {0, 0, 0}, {0, 0, 0.3F}};
  const std::vector<std::size_t> parents = {0, 0, 1};
  Votes votes;
  Rng rng(1, "chain");
  for (int i = 0; i < 300; ++i) {
    const auto joint = static_cast<std::size_t>(i) % 3;
    const auto noise = [&] { return static_cast<float>(0.001 * rng.normal()); };
    votes.joints.push_back(places[joint] + Eigen::Vector3f(noise(), noise(), noise()));
    votes.parents.push_back(places[parents[joint]] + Eigen::Vector3f(noise(), noise(), noise()));
  }
  const GroupedSkeleton skeleton = mean_shift_grouping(votes);
  ASSERT_EQ(skeleton.parents, (std::vector<int>{-1, 0, 1}));
  for (std::size_t j = 0; j < 3; ++j) {
    // A mean of 100 votes of deviation 0.001 is within 0.0005 by five standard deviations.
    EXPECT_LT((skeleton.joints[j] - places[j]).cwiseAbs().maxCoeff(), 0.0005F);
  }
}

// The first neighbour in index order is left out, which is not the vote itself: the second of two votes sees only
// itself.
TEST(VoteClustering, LeavesOutTheNeighbourOfLowestIndex) {
  Votes votes;
  votes.joints = {{0, 0, 0}, {0.006F, 0, 0}};
  votes.parents = votes.joints;
  // Vote 0 moves to vote 1, vote 1 stays: one joint in the middle of both. Were each to see the other, they would swap
  // places for ever and stay two joints.
  const GroupedSkeleton skeleton = mean_shift_grouping(votes);
  ASSERT_EQ(skeleton.joints.size(), 1u);
  EXPECT_NEAR(skeleton.joints[0].x(), 0.003F, 1e-7F);
}

// By hand, h = 0.01: a chain of three votes 0.008 apart with confidences 1, 1, 0.5. The first round moves them to
// (0 + 8)/2 = 4, (0 + 8 + 0.5·16)/2.5 = 6.4 and (8 + 0.5·16)/1.5 = 10.6667 thousandths. All are then within h of each
// other, and the second round takes all to (4 + 6.4 + 0.5·10.6667)/2.5 = 6.2933: one joint at the weighted mean of the
// votes themselves, (0 + 8 + 0.5·16)/2.5 = 6.4.
TEST(VoteClustering, ThePapersFormAveragesAllVotesWithinTheBandwidth) {
  Votes votes;
  votes.joints = {{0, 0, 0}, {0.008F, 0, 0}, {0.016F, 0, 0}};
  votes.parents = votes.joints;
  votes.joint_confidence = {1.0F, 1.0F, 0.5F};
  MeanShiftOptions options;
  options.form = MeanShiftForm::kPaper;
  const GroupedSkeleton paper = mean_shift_grouping(votes, options);
  ASSERT_EQ(paper.joints.size(), 1u);
  EXPECT_NEAR(paper.joints[0].x(), 0.0064F, 1e-7F);
  const Votes many = drawn_votes(700, 12, 0.006, 700);
  options.form = MeanShiftForm::kPublished;
  const GroupedSkeleton published = mean_shift_grouping(many, options);
  expect_same(published, mean_shift_grouping(many), "the published form is the default");
  options.form = MeanShiftForm::kPaper;
  EXPECT_NE(mean_shift_grouping(many, options).joints, published.joints);
}

TEST(VoteClustering, ThePapersFormIsComparingAllPairs) {
  for (const std::size_t count : {2u, 40u, 700u}) {
    const Votes votes = drawn_votes(count, 12, 0.006, count);
    MeanShiftOptions options;
    options.form = MeanShiftForm::kPaper;
    options.max_iterations = 0;  // of the published form alone
    expect_same(mean_shift_grouping(votes, options), Plain::mean_shift(votes, options), std::to_string(count));
  }
}

TEST(VoteClustering, EmptyAndHopelessVotes) {
  EXPECT_TRUE(mean_shift_grouping({}).joints.empty());
  EXPECT_TRUE(mean_shift_grouping({}).parents.empty());
  EXPECT_TRUE(threshold_grouping({}).joints.empty());
  Votes votes = drawn_votes(20, 2, 0.001, 1);
  votes.parent_confidence.assign(20, 0.01F);
  const GroupedSkeleton skeleton = mean_shift_grouping(votes);
  ASSERT_EQ(skeleton.joints.size(), 1u);
  EXPECT_EQ(skeleton.joints[0], Eigen::Vector3f(Eigen::Vector3f::Zero()));
  EXPECT_EQ(skeleton.parents, std::vector<int>{0});  // its own parent, as published
  EXPECT_TRUE(threshold_grouping(votes).parents.empty());
}

TEST(VoteClustering, OneVoteIsARoot) {
  Votes votes;
  votes.joints = {{0.1F, 0.2F, 0.3F}};
  votes.parents = {{0, 0, 0}};
  for (const GroupedSkeleton& skeleton : {mean_shift_grouping(votes), threshold_grouping(votes)}) {
    ASSERT_EQ(skeleton.joints.size(), 1u);
    EXPECT_LT((skeleton.joints[0] - votes.joints[0]).norm(), 1e-7F);
    EXPECT_EQ(skeleton.parents, std::vector<int>{-1});
  }
}

TEST(VoteClustering, DropsSmallClustersUnlessAllAreSmall) {
  Votes votes;
  for (int i = 0; i < 9; ++i) votes.joints.emplace_back(i < 6 ? 0.0F : 0.3F, 0.0F, 0.0F);
  votes.parents = votes.joints;
  EXPECT_EQ(mean_shift_grouping(votes).joints.size(), 1u);
  MeanShiftOptions options;
  options.min_cluster_size = 7;
  EXPECT_EQ(mean_shift_grouping(votes, options).joints.size(), 2u);
}

// All in one place, and in two places whose cells are in reach of each other: looking at every vote near a vote would
// be 1e10 comparisons a round.
TEST(VoteClustering, CrowdedPlacesTakeLinearTime) {
  const int count = 100000;
  Votes votes;
  for (int i = 0; i < count; ++i) votes.joints.emplace_back(i % 2 == 0 ? 0.1F : 0.1123F, 0.2F, 0.3F);
  votes.parents = votes.joints;
  EXPECT_EQ(mean_shift_grouping(votes).joints.size(), 2u);
  for (Eigen::Vector3f& vote : votes.joints) vote = {0.1F, 0.2F, 0.3F};
  EXPECT_EQ(mean_shift_grouping(votes).joints.size(), 1u);
  EXPECT_EQ(threshold_grouping(votes).joints.size(), 1u);
}

TEST(VoteClustering, FarVotesAreVotes) {
  Votes votes = drawn_votes(300, 5, 0.002, 4);
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector3f far(i % 2 == 0 ? 1e15F : -1e14F, 3e9F, -7e5F);
    votes.joints.push_back(far);
    votes.parents.push_back(far);
    votes.joint_confidence.push_back(1.0F);
    votes.parent_confidence.push_back(1.0F);
  }
  expect_same(mean_shift_grouping(votes), Plain::mean_shift(votes, {}), "far votes");
  expect_same(threshold_grouping(votes), Plain::threshold(votes, {}), "far votes, threshold");
}

TEST(VoteClustering, RefusesBadVotesByName) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinite = std::numeric_limits<float>::infinity();
  const Votes good = drawn_votes(10, 2, 0.001, 2);
  EXPECT_EQ(place_of_error(good), "");
  Votes bad = good;
  bad.joints[3].y() = nan;
  EXPECT_EQ(place_of_error(bad), "joints[3]");
  bad = good;
  bad.parents[9].z() = -infinite;
  EXPECT_EQ(place_of_error(bad), "parents[9]");
  bad = good;
  bad.joints[1].x() = 2e15F;
  EXPECT_EQ(place_of_error(bad), "joints[1]");
  bad = good;
  bad.joint_confidence[4] = nan;
  EXPECT_EQ(place_of_error(bad), "joint_confidence[4]");
  bad = good;
  bad.parent_confidence[0] = infinite;
  EXPECT_EQ(place_of_error(bad), "parent_confidence[0]");
  bad = good;
  bad.parents.pop_back();
  EXPECT_EQ(place_of_error(bad), "parents");
  bad = good;
  bad.joint_confidence.pop_back();
  EXPECT_EQ(place_of_error(bad), "joint_confidence");
  EXPECT_THROW(threshold_grouping(bad), InputError);
}

TEST(VoteClustering, RefusesBadOptions) {
  const Votes votes = drawn_votes(10, 2, 0.001, 2);
  for (const float bandwidth : {0.0F, -1.0F, std::numeric_limits<float>::quiet_NaN(), 1e30F}) {
    MeanShiftOptions options;
    options.bandwidth = bandwidth;
    EXPECT_THROW(mean_shift_grouping(votes, options), InputError);
    ThresholdOptions threshold;
    threshold.distance = bandwidth;
    EXPECT_THROW(threshold_grouping(votes, threshold), InputError);
  }
  MeanShiftOptions negative;
  negative.max_neighbours = -1;
  EXPECT_THROW(mean_shift_grouping(votes, negative), InputError);
}

TEST(PointCells, EveryPointIsVisitedOnceWithItsFirstNeighbours) {
  const Votes votes = drawn_votes(3000, 8, 0.02, 9);
  const std::vector<Eigen::Vector3f>& points = votes.joints;
  const float radius = 0.03F;
  const geometry::PointCells cells(points, radius);
  std::vector<int> visits(points.size(), 0);
  std::vector<std::vector<int>> found(points.size());
  cells.first_neighbours(20, [&](std::size_t i, const std::vector<geometry::PointCells::Neighbour>& neighbours) {
    ++visits[i];
    for (const auto& neighbour : neighbours) found[i].push_back(neighbour.index);
  });
  for (std::size_t i = 0; i < points.size(); ++i) {
    ASSERT_EQ(visits[i], 1);
    std::vector<int> expected, inside;
    for (std::size_t k = 0; k < points.size(); ++k) {
      const float squared = geometry::squared_distance(points[k], points[i]);
      if (squared < radius * radius && expected.size() < 20) expected.push_back(static_cast<int>(k));
      if (std::sqrt(squared) <= radius) inside.push_back(static_cast<int>(k));
    }
    ASSERT_EQ(found[i], expected) << i;
    std::vector<int> within = cells.within(i);
    std::sort(within.begin(), within.end());
    ASSERT_EQ(within, inside) << i;
  }
}

}  // namespace
}  // namespace anigen::skeleton_field
