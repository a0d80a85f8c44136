#include "anigen/eval/skeleton/joint_ties.h"

#include <cmath>
#include <vector>

#include "anigen/eval/transport/exact_transport.h"
#include "anigen/eval/transport/wasserstein.h"

namespace anigen::eval {
namespace {

constexpr double kDepthShare = 1e-3;
constexpr double kParentWeight = 1e-9;

/// Where the parent is and how many joints lie above.
struct Hanging {
  Eigen::Vector3d parent;
  double depth = 0;
};

std::vector<Hanging> hangings(const io::JointTree& tree) {
  std::vector<Hanging> result(tree.size());
  for (std::size_t j = 0; j < tree.size(); ++j) {
    const int parent = tree.parents[j];
    result[j].parent = tree.positions[parent < 0 ? j : static_cast<std::size_t>(parent)];
    for (int at = parent; at >= 0; at = tree.parents[static_cast<std::size_t>(at)]) result[j].depth += 1;
  }
  return result;
}

}  // namespace

Eigen::MatrixXd joint_ties(const io::JointTree& predicted, const io::JointTree& truth) {
  const std::vector<Hanging> a = hangings(predicted), b = hangings(truth);
  Eigen::MatrixXd ties(static_cast<Eigen::Index>(a.size()), static_cast<Eigen::Index>(b.size()));
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < b.size(); ++k)
      ties(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) =
          (a[i].parent - b[k].parent).norm() + kDepthShare * std::abs(a[i].depth - b[k].depth);
  }
  return ties;
}

Eigen::MatrixXd matching_plan(const io::JointTree& predicted, const io::JointTree& truth) {
  check(predicted, "predicted skeleton");
  check(truth, "true skeleton");
  const Eigen::MatrixXd cost =
      squared_distances(predicted.positions, truth.positions) + kParentWeight * joint_ties(predicted, truth);
  return exact_transport(cost, uniform_masses(predicted.size()), uniform_masses(truth.size())).plan;
}

}  // namespace anigen::eval
