#include "anigen/models/rignet/skeleton_tree.h"

#include <cmath>
#include <limits>

#include "anigen/core/error.h"

namespace anigen::models::rignet {
namespace {

constexpr double kLogFloor = 1e-10, kMiddle = 0.02, kMiddleFactor = 0.5, kOutsideCost = 2.0;

bool in_middle(const Eigen::Vector3d& joint) { return std::abs(joint.x()) <= kMiddle; }

double edge_cost(const JointGraph& graph, Eigen::Index a, Eigen::Index b) {
  double cost = -std::log(graph.bone(a, b) + kLogFloor);
  if (graph.outside(a, b) > 1.0) cost = kOutsideCost * graph.outside(a, b);
  const auto joint = [&](Eigen::Index j) -> const Eigen::Vector3d& {
    return graph.joints[static_cast<std::size_t>(j)];
  };
  return in_middle(joint(a)) && in_middle(joint(b)) ? kMiddleFactor * cost : cost;
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

// The mirror image of each joint in x = 0, itself in the middle; empty when one has none or no joint is in the middle.
std::vector<Eigen::Index> twins(const std::vector<Eigen::Vector3d>& joints) {
  constexpr double kSame = 1e-5;  // fp32 coordinates in a box of side one
  std::vector<Eigen::Index> found(joints.size(), -1);
  bool any_in_middle = false;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (in_middle(joints[j])) {
      found[j] = static_cast<Eigen::Index>(j);
      any_in_middle = true;
    }
    const Eigen::Vector3d image(-joints[j].x(), joints[j].y(), joints[j].z());
    for (std::size_t other = j + 1; other < joints.size() && found[j] < 0; ++other) {
      if (found[other] >= 0 || (joints[other] - image).norm() > kSame) continue;
      found[j] = static_cast<Eigen::Index>(other);
      found[other] = static_cast<Eigen::Index>(j);
    }
    if (found[j] < 0) return {};
  }
  return any_in_middle ? found : std::vector<Eigen::Index>();
}

Eigen::Index nearest_in_middle(const std::vector<Eigen::Vector3d>& joints, Eigen::Index to) {
  Eigen::Index nearest = to;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const double distance = (joints[j] - joints[static_cast<std::size_t>(to)]).norm();
    if (!in_middle(joints[j]) || distance >= least) continue;
    least = distance;
    nearest = static_cast<Eigen::Index>(j);
  }
  return nearest;
}

// Prim's algorithm, one joint or one pair of twins at a time.
class GrowingTree {
 public:
  explicit GrowingTree(const JointGraph& graph)
      : graph_(graph),
        twins_(twins(graph.joints)),
        parents_(graph.joints.size(), -1),
        cheapest_(graph.joints.size(), std::numeric_limits<double>::infinity()),
        is_in_(graph.joints.size(), false) {}

  std::vector<int> grown_from(Eigen::Index root) {
    if (!twins_.empty()) root = nearest_in_middle(graph_.joints, root);
    for (Eigen::Index next = root; next >= 0; next = cheapest()) {
      add(next);
      const Eigen::Index twin = twins_.empty() ? next : twins_[at(next)];
      if (twin == next) continue;
      parents_[at(twin)] = static_cast<int>(twins_[at(parents_[at(next)])]);
      add(twin);
    }
    return parents_;
  }

 private:
  static std::size_t at(Eigen::Index j) { return static_cast<std::size_t>(j); }

  void add(Eigen::Index joint) {
    is_in_[at(joint)] = true;
    for (Eigen::Index j = 0; j < static_cast<Eigen::Index>(parents_.size()); ++j) {
      const double cost = edge_cost(graph_, joint, j);
      if (is_in_[at(j)] || cost >= cheapest_[at(j)]) continue;
      cheapest_[at(j)] = cost;
      parents_[at(j)] = static_cast<int>(joint);
    }
  }

  // Of the joints to come; -1 when there are none.
  Eigen::Index cheapest() const {
    Eigen::Index best = -1;
    for (Eigen::Index j = 0; j < static_cast<Eigen::Index>(parents_.size()); ++j) {
      const bool comes_with_its_twin = !twins_.empty() && twins_[at(j)] != j && graph_.joints[at(j)].x() < 0.0;
      if (is_in_[at(j)] || comes_with_its_twin) continue;
      if (best < 0 || cheapest_[at(j)] < cheapest_[at(best)]) best = j;
    }
    return best;
  }

  const JointGraph& graph_;
  std::vector<Eigen::Index> twins_;
  std::vector<int> parents_;
  std::vector<double> cheapest_;
  std::vector<bool> is_in_;
};

}  // namespace

std::vector<int> skeleton_tree(const JointGraph& graph) {
  check_graph(graph);
  Eigen::Index root = 0;
  graph.root.maxCoeff(&root);
  return GrowingTree(graph).grown_from(root);
}

}  // namespace anigen::models::rignet
