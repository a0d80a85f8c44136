#include "anigen/geometry/spanning_trees.h"

#include <lemon/full_graph.h>
#include <lemon/min_cost_arborescence.h>

#include <cstddef>
#include <limits>
#include <string>

#include "anigen/core/error.h"

namespace anigen::geometry {
namespace {

using ParentGraph = lemon::FullDigraph;
using ParentCosts = ParentGraph::ArcMap<double>;

std::size_t nearest_to_mean(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& point : points) mean += point / static_cast<double>(points.size());
  std::size_t nearest = 0;
  for (std::size_t j = 1; j < points.size(); ++j) {
    if ((points[j] - mean).squaredNorm() < (points[nearest] - mean).squaredNorm()) nearest = j;
  }
  return nearest;
}

}  // namespace

std::vector<int> shortest_tree(const std::vector<Eigen::Vector3d>& points) {
  for (std::size_t j = 0; j < points.size(); ++j) {
    if (!points[j].allFinite()) throw InputError("", "joints[" + std::to_string(j) + "]", "is not finite");
  }
  std::vector<int> parents(points.size(), -1);
  std::vector<bool> reached(points.size(), false);
  std::vector<double> squared(points.size(), std::numeric_limits<double>::infinity());
  std::size_t next = points.empty() ? 0 : nearest_to_mean(points);
  for (std::size_t step = 0; step < points.size(); ++step) {
    const std::size_t from = next;
    reached[from] = true;
    next = points.size();
    for (std::size_t j = 0; j < points.size(); ++j) {
      if (reached[j]) continue;
      const double distance = (points[j] - points[from]).squaredNorm();
      if (distance < squared[j]) {
        squared[j] = distance;
        parents[j] = static_cast<int>(from);
      }
      if (next == points.size() || squared[j] < squared[next]) next = j;
    }
  }
  return parents;
}

std::vector<int> likeliest_tree(const Eigen::MatrixXd& log_likelihood) {
  const Eigen::Index count = log_likelihood.rows();
  if (log_likelihood.cols() != count) throw InputError("", "log_likelihood", "is not square");
  if (!log_likelihood.allFinite()) throw InputError("", "log_likelihood", "holds a number that is not finite");
  if (count == 0) return {};
  const auto joints = static_cast<int>(count);
  const int source = joints;
  // Each joint pays for one edge, so what all of its edges cost more changes nothing: costs from 0 on.
  const Eigen::VectorXd best = log_likelihood.rowwise().maxCoeff();
  const Eigen::MatrixXd cost = (-log_likelihood).colwise() + best;
  const double more_than_any_tree = 1.0 + cost.rowwise().maxCoeff().sum();
  const ParentGraph graph(joints + 1);
  ParentCosts costs(graph, 0.0);
  for (int child = 0; child < joints; ++child) {
    for (int parent = 0; parent < joints; ++parent) {
      if (child != parent) costs[graph.arc(graph(parent), graph(child))] = cost(child, parent);
    }
    costs[graph.arc(graph(source), graph(child))] = cost(child, child) + more_than_any_tree;
  }
  lemon::MinCostArborescence<ParentGraph, ParentCosts> tree(graph, costs);
  tree.run(graph(source));
  std::vector<int> parents(static_cast<std::size_t>(joints), -1);
  for (int child = 0; child < joints; ++child) {
    const int parent = graph.index(graph.source(tree.pred(graph(child))));
    parents[static_cast<std::size_t>(child)] = parent == source ? -1 : parent;
  }
  return parents;
}

}  // namespace anigen::geometry
