#include "anigen/geometry/spanning_trees.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/random.h"

namespace anigen::geometry {
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

}  // namespace
}  // namespace anigen::geometry
