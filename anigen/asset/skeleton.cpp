#include "anigen/asset/skeleton.h"

#include <lemon/full_graph.h>
#include <lemon/min_cost_arborescence.h>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <limits>
#include <map>
#include <tuple>

#include "anigen/asset/mesh.h"
#include "anigen/core/error.h"
#include "anigen/core/hash.h"
#include "anigen/core/numeric.h"

namespace anigen {

Eigen::Matrix4d Transform::matrix() const {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = rotation.toRotationMatrix() * scale.asDiagonal();
  m.topRightCorner<3, 1>() = translation;
  return m;
}

Transform decompose(const Eigen::Matrix4d& matrix, double* shear_error) {
  const Eigen::Matrix3d linear = matrix.topLeftCorner<3, 3>();
  Transform result;
  result.translation = matrix.topRightCorner<3, 1>();
  // Without shear the columns are orthogonal and their lengths are the scale; that keeps exact inputs exact where
  // the polar factor would only come close.
  const Eigen::Vector3d lengths = linear.colwise().norm();
  const double largest = lengths.maxCoeff();
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  if (lengths.minCoeff() > 1e-12 * largest && largest > 0.0) {
    const Eigen::Matrix3d directions = linear * lengths.cwiseInverse().asDiagonal();
    const double skew = (directions.transpose() * directions - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(skew < 1e-9 ? directions : linear,
                                                Eigen::ComputeFullU | Eigen::ComputeFullV);
    rotation = svd.matrixU() * svd.matrixV().transpose();
    result.scale = skew < 1e-9 ? lengths : Eigen::Vector3d((rotation.transpose() * linear).diagonal());
  } else {
    // A collapsed axis: the orientation is only partly defined.
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(linear, Eigen::ComputeFullU | Eigen::ComputeFullV);
    rotation = svd.matrixU() * svd.matrixV().transpose();
    result.scale = (rotation.transpose() * linear).diagonal();
  }
  if (rotation.determinant() < 0.0) {
    rotation.col(0) = -rotation.col(0);
    result.scale.x() = -result.scale.x();
  }
  result.rotation = Eigen::Quaterniond(rotation).normalized();
  if (shear_error != nullptr) {
    const Eigen::Matrix4d difference = matrix - result.matrix();
    *shear_error = difference.topLeftCorner<3, 3>().cwiseAbs().maxCoeff() / (largest > 0.0 ? largest : 1.0);
  }
  return result;
}

std::vector<Eigen::Vector3d> Skeleton::positions() const {
  std::vector<Eigen::Vector3d> result;
  result.reserve(bind.size());
  for (const Eigen::Matrix4d& m : bind) result.emplace_back(m.topRightCorner<3, 1>());
  return result;
}

std::vector<Eigen::Matrix4d> forward_kinematics(const std::vector<int>& parents, const Pose& pose) {
  std::vector<Eigen::Matrix4d> world(parents.size());
  for (std::size_t j = 0; j < parents.size(); ++j) {
    const Eigen::Matrix4d local = pose[j].matrix();
    world[j] = parents[j] < 0 ? local : Eigen::Matrix4d(world[at(parents[j])] * local);
  }
  return world;
}

Pose local_pose(const std::vector<int>& parents, const std::vector<Eigen::Matrix4d>& world) {
  Pose pose;
  for (std::size_t j = 0; j < world.size(); ++j)
    pose.push_back(decompose(parents[j] < 0 ? world[j] : Eigen::Matrix4d(world[at(parents[j])].inverse() * world[j])));
  return pose;
}

Skeleton skeleton_from_joints(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents,
                              const std::vector<std::string>& names) {
  if (!names.empty() && names.size() != positions.size())
    throw InputError("", "names",
                     "has " + std::to_string(names.size()) + " for " + std::to_string(positions.size()) +
                         " joints, expected one for each or none");
  Skeleton skeleton;
  skeleton.parents = parents;
  for (std::size_t j = 0; j < positions.size(); ++j) {
    skeleton.names.push_back(names.empty() ? "joint_" + std::to_string(j) : names[j]);
    Transform world, local;
    world.translation = positions[j];
    local.translation = parents[j] < 0 ? positions[j] : Eigen::Vector3d(positions[j] - positions[at(parents[j])]);
    skeleton.bind.push_back(world.matrix());
    skeleton.rest.push_back(local);
  }
  return skeleton;
}

std::string tree_signature(const std::vector<int>& parents) {
  const std::vector<int> order = parents_first({std::vector<Eigen::Vector3d>(parents.size()), parents});
  std::vector<std::vector<int>> children(parents.size());
  std::map<std::vector<int>, int> numbers;
  std::vector<int> roots;
  for (auto joint = order.rbegin(); joint != order.rend(); ++joint) {
    std::vector<int>& own = children[at(*joint)];
    std::sort(own.begin(), own.end());
    const int number = numbers.try_emplace(own, static_cast<int>(numbers.size())).first->second;
    const int parent = parents[at(*joint)];
    (parent < 0 ? roots : children[at(parent)]).push_back(number);
  }
  // Numbers are handed out in an order that depends on the skeleton; the text of a tree does not. Built from the
  // smallest up, since a tree's number is larger than those of its children.
  std::vector<std::string> texts(numbers.size());
  const auto text_of = [&texts](const std::vector<int>& kids) {
    std::vector<std::string> parts;
    for (const int kid : kids) parts.push_back(texts[at(kid)]);
    std::sort(parts.begin(), parts.end());
    std::string text = "(";
    for (const std::string& part : parts) text += part;
    return sha256(text + ")").substr(0, 32);
  };
  std::vector<const std::vector<int>*> of(numbers.size());
  for (const auto& [kids, value] : numbers) of[at(value)] = &kids;
  for (std::size_t n = 0; n < of.size(); ++n) texts[n] = text_of(*of[n]);
  if (roots.empty()) return "";
  return roots.size() == 1 ? texts[at(roots.front())] : text_of(roots);
}

JointTree joint_tree(const Skeleton& skeleton) { return {skeleton.positions(), skeleton.parents}; }

std::vector<int> roots(const JointTree& tree) {
  std::vector<int> result;
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (tree.parents[j] < 0) result.push_back(static_cast<int>(j));
  }
  return result;
}

JointTree connected(JointTree tree) {
  const std::vector<int> all = roots(tree);
  for (std::size_t i = 1; i < all.size(); ++i) tree.parents[at(all[i])] = all[0];
  return tree;
}

std::vector<int> parents_first(const JointTree& tree) {
  std::vector<std::vector<int>> children(tree.size());
  std::vector<int> order = roots(tree);
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (tree.parents[j] >= 0) children[at(tree.parents[j])].push_back(static_cast<int>(j));
  }
  for (std::size_t i = 0; i < order.size(); ++i) {
    const std::vector<int>& next = children[at(order[i])];
    order.insert(order.end(), next.begin(), next.end());
  }
  return order;
}

void check(const JointTree& tree, const std::string& file) {
  const std::size_t n = tree.size();
  if (n == 0) throw InputError(file, "", "the skeleton has no joint");
  if (tree.parents.size() != n)
    throw InputError(file, "", std::to_string(n) + " joints but " + std::to_string(tree.parents.size()) + " parents");
  for (std::size_t j = 0; j < n; ++j) {
    const std::string place = "joint " + std::to_string(j);
    const int parent = tree.parents[j];
    if (!tree.positions[j].allFinite()) throw InputError(file, place, "its position is not finite");
    if (parent < -1 || parent >= static_cast<int>(n))
      throw InputError(file, place, "parent " + std::to_string(parent) + " of " + std::to_string(n) + " joints");
  }
  // A joint whose chain of parents is longer than there are joints hangs on a cycle; marking what is known to end at
  // a root keeps this linear.
  std::vector<char> grounded(n, 0);
  std::vector<std::size_t> chain;
  for (std::size_t start = 0; start < n; ++start) {
    chain.clear();
    int j = static_cast<int>(start);
    while (j >= 0 && !grounded[at(j)]) {
      chain.push_back(static_cast<std::size_t>(j));
      if (chain.size() > n)
        throw InputError(file, "joint " + std::to_string(start), "is its own ancestor: the skeleton has a cycle");
      j = tree.parents[at(j)];
    }
    for (const std::size_t k : chain) grounded[k] = 1;
  }
}

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

// Mirrored joints may be this far from each other's image, as a share of the skeleton's diagonal.
constexpr double kMirrorTolerance = 0.05;

struct Chain {
  std::vector<std::size_t> joints;
  int parent = -1;  // the chain it begins at, and the place there
  std::size_t place = 0;
  double length = 0.0;  // from where it begins
  int twin = -1;        // the chain that mirrors it
};

class Chains {
 public:
  Chains(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents)
      : positions_(positions), parents_(parents), reach_(positions.size(), 0.0), children_(positions.size()) {
    Box box;
    for (std::size_t j = 0; j < positions.size(); ++j) {
      box.extend(positions[j]);
      if (j > 0) children_[at(parents[j])].push_back(j);
    }
    tolerance_ = kMirrorTolerance * box.diagonal();
    for (std::size_t j = positions.size(); j-- > 1;) {
      const auto parent = static_cast<std::size_t>(parents[j]);
      reach_[parent] = std::max(reach_[parent], reach_from_parent(j));
    }
    cut();
    pair();
  }

  bool has_extent() const { return tolerance_ > 0.0; }

  std::vector<std::string> names() const {
    std::vector<std::string> names(positions_.size());
    std::vector<int> number(chains_.size(), -1);
    int next = 0;
    for (std::size_t c = 0; c < chains_.size(); ++c) {
      if (number[c] >= 0) continue;
      number[c] = next++;
      if (chains_[c].twin >= 0) number[at(chains_[c].twin)] = number[c];
    }
    for (std::size_t c = 0; c < chains_.size(); ++c) {
      const char* side = chains_[c].twin < 0 ? "" : is_left(c) ? "_L" : "_R";
      for (std::size_t i = 0; i < chains_[c].joints.size(); ++i) {
        char text[64];
        std::snprintf(text, sizeof text, "chain_%d_%02zu%s", number[c], i, side);
        names[chains_[c].joints[i]] = text;
      }
    }
    return names;
  }

  std::vector<int> mirrored() const {
    std::vector<int> others(positions_.size(), -1);
    for (const Chain& chain : chains_) {
      if (chain.twin < 0) continue;
      const Chain& twin = chains_[at(chain.twin)];
      for (std::size_t i = 0; i < chain.joints.size(); ++i) others[chain.joints[i]] = static_cast<int>(twin.joints[i]);
    }
    return others;
  }

 private:
  double reach_from_parent(std::size_t j) const {
    return reach_[j] + (positions_[j] - positions_[at(parents_[j])]).norm();
  }

  /// Chains in the order of their numbers.
  void cut() {
    chains_.emplace_back();
    chains_[0].length = reach_[0];
    extend(0, 0);
    for (std::size_t c = 0; c < chains_.size(); ++c) {
      std::vector<std::tuple<double, std::size_t, std::size_t>> begins;  // −length, first joint, place
      const std::vector<std::size_t> joints = chains_[c].joints;
      for (std::size_t place = 0; place < joints.size(); ++place) {
        for (const std::size_t child : children_[joints[place]]) {
          if (place + 1 < joints.size() && child == joints[place + 1]) continue;
          begins.emplace_back(-reach_from_parent(child), child, place);
        }
      }
      std::sort(begins.begin(), begins.end());
      for (const auto& [length, first, place] : begins) {
        chains_.emplace_back();
        chains_.back().parent = static_cast<int>(c);
        chains_.back().place = place;
        chains_.back().length = -length;
        extend(chains_.size() - 1, first);
      }
    }
  }

  void extend(std::size_t chain, std::size_t joint) {
    while (true) {
      chains_[chain].joints.push_back(joint);
      int next = -1;
      for (const std::size_t child : children_[joint]) {
        if (is_side(child)) continue;
        if (next < 0 || reach_from_parent(child) > reach_from_parent(static_cast<std::size_t>(next)))
          next = static_cast<int>(child);
      }
      if (next < 0) return;
      joint = static_cast<std::size_t>(next);
    }
  }

  Eigen::Vector3d mirrored(std::size_t joint) const {
    Eigen::Vector3d image = positions_[joint];
    image.x() = 2.0 * positions_[0].x() - image.x();
    return image;
  }

  /// One of two siblings that mirror each other: neither goes on for both.
  bool is_side(std::size_t joint) const {
    for (const std::size_t other : children_[at(parents_[joint])]) {
      if (other == joint ||
          (positions_[joint].x() > positions_[0].x()) == (positions_[other].x() > positions_[0].x())) {
        continue;
      }
      if ((positions_[other] - mirrored(joint)).norm() < tolerance_) return true;
    }
    return false;
  }

  /// The largest distance of a joint of one chain from the image of the other's.
  double mirror_distance(const Chain& a, const Chain& b) const {
    double largest = 0.0;
    for (std::size_t i = 0; i < a.joints.size(); ++i)
      largest = std::max(largest, (positions_[a.joints[i]] - mirrored(b.joints[i])).norm());
    return largest;
  }

  double mean_offset(const Chain& chain) const {
    double sum = 0.0;
    for (const std::size_t joint : chain.joints) sum += positions_[joint].x() - positions_[0].x();
    return sum / static_cast<double>(chain.joints.size());
  }
  bool is_left(std::size_t c) const { return mean_offset(chains_[c]) > 0.0; }

  bool begin_alike(const Chain& a, const Chain& b) const {
    if (a.place != b.place || a.parent < 0 || b.parent < 0) return false;
    return a.parent == b.parent || chains_[at(a.parent)].twin == b.parent;
  }

  void pair() {
    for (std::size_t a = 1; a < chains_.size(); ++a) {
      if (chains_[a].twin >= 0) continue;
      double least = tolerance_;
      int twin = -1;
      for (std::size_t b = a + 1; b < chains_.size(); ++b) {
        if (chains_[b].twin >= 0 || chains_[a].joints.size() != chains_[b].joints.size()) continue;
        if (!begin_alike(chains_[a], chains_[b])) continue;
        if (mean_offset(chains_[a]) * mean_offset(chains_[b]) >= 0.0) continue;
        const double distance = mirror_distance(chains_[a], chains_[b]);
        if (distance < least) {
          least = distance;
          twin = static_cast<int>(b);
        }
      }
      if (twin < 0) continue;
      chains_[a].twin = twin;
      chains_[at(twin)].twin = static_cast<int>(a);
    }
  }

  const std::vector<Eigen::Vector3d>& positions_;
  const std::vector<int>& parents_;
  std::vector<double> reach_;  // from a joint to the farthest tip below it
  std::vector<std::vector<std::size_t>> children_;
  double tolerance_ = 0.0;
  std::vector<Chain> chains_;
};

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
  // Apart, since GCC 14 sees numbers without a value in the sum of an expression.
  const Eigen::VectorXd dearest = cost.rowwise().maxCoeff();
  const double more_than_any_tree = 1.0 + dearest.sum();
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
    parents[at(child)] = parent == source ? -1 : parent;
  }
  return parents;
}

namespace {

void check_ordered(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents) {
  if (positions.size() != parents.size()) throw InputError("", "", "joint_names: as many parents as positions");
  for (std::size_t j = 0; j < parents.size(); ++j) {
    const bool ordered = j == 0 ? parents[j] == -1 : parents[j] >= 0 && static_cast<std::size_t>(parents[j]) < j;
    if (!ordered) throw InputError("", "joint " + std::to_string(j), "parents come before children, the root first");
    if (!positions[j].allFinite()) throw InputError("", "joint " + std::to_string(j), "is not finite");
  }
}

}  // namespace

std::vector<int> mirrored_joints(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents) {
  check_ordered(positions, parents);
  if (positions.empty()) return {};
  return Chains(positions, parents).mirrored();
}

std::vector<std::string> joint_names(const std::vector<Eigen::Vector3d>& positions, const std::vector<int>& parents) {
  check_ordered(positions, parents);
  if (positions.empty()) return {};
  const Chains chains(positions, parents);
  if (chains.has_extent()) return chains.names();
  std::vector<std::string> names;
  for (std::size_t j = 0; j < positions.size(); ++j) {
    char text[32];
    std::snprintf(text, sizeof text, "joint_%03zu", j);
    names.emplace_back(text);
  }
  return names;
}

}  // namespace anigen
