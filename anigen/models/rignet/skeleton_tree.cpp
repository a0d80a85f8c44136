#include "anigen/models/rignet/skeleton_tree.h"

#include <cmath>
#include <limits>

#include "anigen/core/error.h"

namespace anigen::models::rignet {
namespace {

constexpr double kLogFloor = 1e-10, kMiddle = 0.02, kMiddleFactor = 0.5, kOutsideCost = 2.0;

double edge_cost(const JointGraph& graph, Eigen::Index a, Eigen::Index b) {
  double cost = -std::log(graph.bone(a, b) + kLogFloor);
  if (graph.outside(a, b) > 1.0) cost = kOutsideCost * graph.outside(a, b);
  const auto on_middle = [&](Eigen::Index j) {
    return std::abs(graph.joints[static_cast<std::size_t>(j)].x()) <= kMiddle;
  };
  return on_middle(a) && on_middle(b) ? kMiddleFactor * cost : cost;
}

void check_graph(const JointGraph& graph) {
  const auto count = static_cast<Eigen::Index>(graph.joints.size());
  const auto square = [&](const Eigen::MatrixXd& m) { return m.rows() == count && m.cols() == count; };
  if (count == 0) throw InputError("", "joints", "there are none");
  if (!square(graph.bone) || !square(graph.outside) || graph.root.size() != count) {
    throw InputError("", "joints", "are not as many as the probabilities are for");
  }
  if (!graph.bone.allFinite() || !graph.root.allFinite() || !graph.outside.allFinite()) {
    throw InputError("", "bone", "holds probabilities that are not finite");
  }
}

}  // namespace

std::vector<int> skeleton_tree(const JointGraph& graph) {
  check_graph(graph);
  const auto count = static_cast<Eigen::Index>(graph.joints.size());
  std::vector<int> parents(graph.joints.size(), -1);
  std::vector<double> cheapest(graph.joints.size(), std::numeric_limits<double>::infinity());
  std::vector<bool> is_in(graph.joints.size(), false);
  Eigen::Index next = 0;
  graph.root.maxCoeff(&next);
  for (Eigen::Index added = 0; added < count; ++added) {
    is_in[static_cast<std::size_t>(next)] = true;
    Eigen::Index best = -1;
    for (Eigen::Index j = 0; j < count; ++j) {
      const auto to = static_cast<std::size_t>(j);
      if (is_in[to]) continue;
      const double cost = edge_cost(graph, next, j);
      if (cost < cheapest[to]) {
        cheapest[to] = cost;
        parents[to] = static_cast<int>(next);
      }
      if (best < 0 || cheapest[to] < cheapest[static_cast<std::size_t>(best)]) best = j;
    }
    next = best;
  }
  return parents;
}

}  // namespace anigen::models::rignet
