#include "anigen/metrics/published_protocols.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <utility>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/metrics/transport_plan.h"

namespace anigen::metrics {

namespace {

constexpr double kSpacing = 0.01, kMiddlePlane = 0.02, kFoldBack = 1e8;
constexpr std::size_t kMostJoints = 2000;

std::size_t cell(const std::array<int, 3>& index) {
  const std::size_t n = AnymateOccupancy::kResolution;
  return (static_cast<std::size_t>(index[0]) * n + static_cast<std::size_t>(index[1])) * n +
         static_cast<std::size_t>(index[2]);
}

void check_input(const std::vector<Eigen::Vector3d>& joints, const Eigen::MatrixXd& parents) {
  const auto n = static_cast<Eigen::Index>(joints.size());
  if (joints.empty()) throw InputError("", "joints", "the skeleton has no joint");
  if (joints.size() > kMostJoints) throw InputError("", "joints", "more than 2000 joints");
  if (parents.rows() != n || parents.cols() != n) {
    throw InputError("", "connectivity",
                     "expected " + std::to_string(n) + " x " + std::to_string(n) + ", found " +
                         std::to_string(parents.rows()) + " x " + std::to_string(parents.cols()));
  }
  if (!parents.allFinite() || parents.minCoeff() < 0.0)
    throw InputError("", "connectivity", "a probability is negative or not finite");
  for (std::size_t j = 0; j < joints.size(); ++j) {
    // The published frame is [-1, 1]; the bound keeps the number of samples along a bone small.
    if (!(joints[j].cwiseAbs().maxCoeff() <= 100.0) || !joints[j].allFinite())
      throw InputError("", "joints[" + std::to_string(j) + "]", "the position is not finite or far outside [-1, 1]");
  }
}

int samples_outside(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const AnymateOccupancy& inside) {
  const double steps = std::nearbyint((b - a).norm() / kSpacing);
  int outside = 0;
  for (int i = 1; i <= static_cast<int>(steps); ++i) outside += !inside.contains(a + (i / steps) * (b - a));
  return outside;
}

Eigen::Vector3d direction(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const Eigen::Vector3d along = to - from;
  const double length = along.norm();
  return length > 0.0 ? Eigen::Vector3d(along / length) : Eigen::Vector3d::Zero();
}

constexpr double kEpsilon = 1e-4, kStop = 1e-3;
constexpr int kIterations = 100;
constexpr double kLargestCost = 1.6e7;  // 128 MB
// exp of less than this below the largest term cannot change a sum of doubles, and most terms are.
constexpr double kNegligible = -45.0;

RowMatrix distances(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b) {
  if (static_cast<double>(a.size()) * static_cast<double>(b.size()) > kLargestCost)
    throw InputError("", "joints", "too many joints on both sides");
  return matrix_of(a.size(), b.size(), [&](std::size_t i, std::size_t k) { return (a[i] - b[k]).norm(); });
}

/// potential_i ← ε (ln mass − LSE_k((other_k − cost_ik)/ε)) for every row. @return Σ |change|
double update(const RowMatrix& cost, const Eigen::VectorXd& other, double log_mass, Eigen::VectorXd& potential) {
  double change = 0;
  Eigen::VectorXd scaled(cost.cols());
  for (Eigen::Index i = 0; i < cost.rows(); ++i) {
    scaled = (other - cost.row(i).transpose()) / kEpsilon;
    const double largest = scaled.maxCoeff();
    double sum = 0;
    for (Eigen::Index k = 0; k < scaled.size(); ++k) {
      if (scaled[k] - largest > kNegligible) sum += std::exp(scaled[k] - largest);
    }
    const double next = kEpsilon * (log_mass - (largest + std::log(sum)));
    change += std::abs(next - potential[i]);
    potential[i] = next;
  }
  return change;
}

ReleasedEmd released_emd(const RowMatrix& cost) {
  const RowMatrix transposed = cost.transpose();
  Eigen::VectorXd u = Eigen::VectorXd::Zero(cost.rows()), v = Eigen::VectorXd::Zero(cost.cols());
  const double log_a = -std::log(static_cast<double>(cost.rows())), log_b = -std::log(static_cast<double>(cost.cols()));
  ReleasedEmd result;
  while (result.iterations < kIterations) {
    const double u_change = update(cost, v, log_a, u), v_change = update(transposed, u, log_b, v);
    ++result.iterations;
    if (u_change < kStop && v_change < kStop) break;
  }
  for (Eigen::Index i = 0; i < cost.rows(); ++i) {
    for (Eigen::Index k = 0; k < cost.cols(); ++k) {
      const double mass = std::exp((u[i] + v[k] - cost(i, k)) / kEpsilon);
      result.plan_mass += mass;
      result.cost += mass * cost(i, k);
    }
  }
  return result;
}

void check_connectivity(const Eigen::MatrixXd& matrix, Eigen::Index joints, const char* which) {
  if (matrix.rows() != joints || matrix.cols() != joints || joints == 0) {
    throw InputError("", which,
                     "expected a square matrix of all joints, found " + std::to_string(matrix.rows()) + " x " +
                         std::to_string(matrix.cols()));
  }
  if (!matrix.allFinite() || matrix.minCoeff() < 0.0) throw InputError("", which, "an entry is negative or not finite");
}

/// The largest entry of every row without the diagonal (which counts as 0).
std::vector<Eigen::Index> best_other_joint(Eigen::MatrixXd matrix) {
  matrix.diagonal().setZero();
  std::vector<Eigen::Index> best(static_cast<std::size_t>(matrix.rows()));
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) matrix.row(i).maxCoeff(&best[at(i)]);
  return best;
}

bool linked(const std::vector<Eigen::Index>& parents, Eigen::Index a, Eigen::Index b) {
  return parents[at(a)] == b || parents[at(b)] == a;
}

using Bones = std::vector<std::array<int, 2>>;

/// Joints and bones without the promise of a tree.
struct JointGraph {
  std::vector<Eigen::Vector3d> joints;
  Bones bones;  ///< parent, child
};

/// Joint → the joint that stands for it. Sorted by x, since only joints in a slab of that width can be near.
std::vector<int> representatives(const std::vector<Eigen::Vector3d>& joints, int root) {
  const int n = static_cast<int>(joints.size());
  std::vector<int> by_x(joints.size());
  std::iota(by_x.begin(), by_x.end(), 0);
  std::sort(by_x.begin(), by_x.end(), [&](int a, int b) { return joints[at(a)].x() < joints[at(b)].x(); });
  std::vector<int> result(joints.size(), -1);
  for (int i = 0; i < n; ++i) {
    if (result[at(i)] >= 0) continue;
    std::vector<int> group{i};
    const double x = joints[at(i)].x();
    auto candidate = std::lower_bound(by_x.begin(), by_x.end(), x - kPuppeteerMerge,
                                      [&](int j, double bound) { return joints[at(j)].x() < bound; });
    for (; candidate != by_x.end() && joints[at(*candidate)].x() <= x + kPuppeteerMerge; ++candidate) {
      const int j = *candidate;
      if (j > i && result[at(j)] < 0 && (joints[at(i)] - joints[at(j)]).norm() < kPuppeteerMerge) group.push_back(j);
    }
    const bool has_root = std::find(group.begin(), group.end(), root) != group.end();
    for (const int j : group) result[at(j)] = has_root ? root : i;
  }
  return result;
}

/// Renames the ends of bones; drops bones from a joint to itself and repeated ones, keeping the order.
Bones renamed(const Bones& bones, const std::vector<int>& name) {
  Bones result;
  std::set<std::array<int, 2>> seen;
  for (const auto& [parent, child] : bones) {
    const std::array<int, 2> bone{name[at(parent)], name[at(child)]};
    if (bone[0] != bone[1] && seen.insert(bone).second) result.push_back(bone);
  }
  return result;
}

/// Keeps the joints marked, numbered anew in their order.
JointGraph compacted(const JointGraph& graph, const std::vector<char>& keep) {
  JointGraph result;
  std::vector<int> name(graph.joints.size(), -1);
  for (std::size_t j = 0; j < graph.joints.size(); ++j) {
    if (!keep[j]) continue;
    name[j] = static_cast<int>(result.joints.size());
    result.joints.push_back(graph.joints[j]);
  }
  result.bones = renamed(graph.bones, name);
  return result;
}

/// Distances between joints that stay never change, so one pass over all pairs from near to far always meets the
/// nearest pair of two components next.
JointGraph with_components_connected(JointGraph graph) {
  const int n = static_cast<int>(graph.joints.size());
  DisjointSets components(graph.joints.size());
  for (const auto& [a, b] : graph.bones) components.join(at(a), at(b));
  if (components.size_of(0) == graph.joints.size()) return graph;
  if (graph.joints.size() > kLargestForest) {
    throw InputError("", "skeleton",
                     "several components of " + std::to_string(n) + " joints together; at most " +
                         std::to_string(kLargestForest) + " can be connected");
  }

  struct Pair {
    double distance;
    int a, b;
  };
  std::vector<Pair> pairs;
  for (int a = 0; a < n; ++a) {
    for (int b = a + 1; b < n; ++b) {
      if (!components.same(at(a), at(b))) pairs.push_back({(graph.joints[at(a)] - graph.joints[at(b)]).norm(), a, b});
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(), [](const Pair& p, const Pair& q) { return p.distance < q.distance; });
  std::vector<int> name(graph.joints.size());
  std::iota(name.begin(), name.end(), 0);
  std::vector<char> keep(graph.joints.size(), 1);
  for (const Pair& pair : pairs) {
    if (!keep[at(pair.a)] || !keep[at(pair.b)] || !components.join(at(pair.a), at(pair.b))) continue;
    if (pair.distance < kPuppeteerConnect) {
      for (int& target : name) {
        if (target == pair.b) target = pair.a;
      }
      keep[at(pair.b)] = 0;
    } else {
      graph.bones.push_back({pair.a, pair.b});
    }
  }
  graph.bones = renamed(graph.bones, name);
  return compacted(graph, keep);
}

}  // namespace

AnymateOccupancy::AnymateOccupancy(const std::vector<std::array<int, 3>>& cells)
    : inside_(static_cast<std::size_t>(kResolution) * kResolution * kResolution, 0) {
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const auto [low, high] = std::minmax_element(cells[i].begin(), cells[i].end());
    if (*low < 0 || *high >= kResolution)
      throw InputError("", "vox[" + std::to_string(i) + "]", "an index is outside [0, 64)");
    inside_[cell(cells[i])] = 1;
  }
}

bool AnymateOccupancy::contains(const Eigen::Vector3d& p) const {
  std::array<int, 3> index{};
  for (int k = 0; k < 3; ++k) {
    const double scaled = std::clamp(32.0 * p[k] + 32.0, 0.0, static_cast<double>(kResolution - 1));
    index[at(k)] = static_cast<int>(std::nearbyint(scaled));
  }
  return inside_[cell(index)] != 0;
}

Eigen::MatrixXd anymate_bone_costs(const std::vector<Eigen::Vector3d>& joints, const Eigen::MatrixXd& parents,
                                   const AnymateOccupancy& inside) {
  check_input(joints, parents);
  Eigen::MatrixXd cost = parents;
  cost.diagonal().setZero();
  for (Eigen::Index i = 0; i < cost.rows(); ++i) cost.row(i) /= cost.row(i).sum() + 1e-6;
  cost = -(cost.array() + 1e-10).log();
  for (Eigen::Index i = 0; i < cost.rows(); ++i) {
    for (Eigen::Index j = i + 1; j < cost.cols(); ++j) {
      const Eigen::Vector3d &a = joints[at(i)], &b = joints[at(j)];
      const int outside = samples_outside(a, b, inside);
      if (outside > 1) cost(i, j) = cost(j, i) = 2.0 * outside;
      if (std::abs(a.x()) < kMiddlePlane && std::abs(b.x()) < kMiddlePlane) {
        cost(i, j) *= 0.5;
        cost(j, i) *= 0.5;
      }
    }
  }
  return cost;
}

std::vector<int> anymate_parents(const std::vector<Eigen::Vector3d>& joints, Eigen::MatrixXd cost, int root) {
  const std::size_t n = joints.size();
  const double infinity = std::numeric_limits<double>::infinity();
  std::vector<int> parents(n, -1);
  std::vector<double> key(n, infinity);
  std::vector<char> in_tree(n, 0);
  key[at(root)] = 0.0;
  for (std::size_t added = 0; added < n; ++added) {
    std::size_t u = n;
    double least = infinity;
    for (std::size_t v = 0; v < n; ++v) {
      if (!in_tree[v] && key[v] < least) {
        least = key[v];
        u = v;
      }
    }
    if (u == n) break;  // what is left cannot be reached
    in_tree[u] = 1;
    const auto row = static_cast<Eigen::Index>(u);
    if (parents[u] >= 0) {
      const Eigen::Vector3d back = direction(joints[u], joints[at(parents[u])]);
      for (std::size_t v = 0; v < n; ++v) {
        const double fold = std::max(0.0, back.dot(direction(joints[u], joints[v])));
        const double penalty = kFoldBack * fold * fold + 1.0;
        const auto column = static_cast<Eigen::Index>(v);
        cost(row, column) += penalty;
        if (v != u) cost(column, row) += penalty;
      }
    }
    for (std::size_t v = 0; v < n; ++v) {
      const double edge = cost(row, static_cast<Eigen::Index>(v));
      if (!in_tree[v] && edge > 0.0 && edge < key[v]) {
        key[v] = edge;
        parents[v] = static_cast<int>(u);
      }
    }
  }
  return parents;
}

AnymateTree grow_anymate_tree(const std::vector<Eigen::Vector3d>& joints, const Eigen::MatrixXd& parents,
                              const AnymateOccupancy& inside) {
  AnymateTree skeleton;
  skeleton.cost = anymate_bone_costs(joints, parents, inside);
  for (int j = 1; j < static_cast<int>(joints.size()); ++j) {
    if (parents(j, j) > parents(skeleton.root, skeleton.root)) skeleton.root = j;
  }
  skeleton.tree = {joints, anymate_parents(joints, skeleton.cost, skeleton.root)};
  return skeleton;
}

ReleasedEmd anymate_emd(const std::vector<Eigen::Vector3d>& predicted, const std::vector<Eigen::Vector3d>& truth) {
  if (predicted.empty() || truth.empty()) throw InputError("", "joints", "a skeleton has no joint");
  return released_emd(distances(predicted, truth));
}

AnymateJointScore anymate_joint(const std::vector<Eigen::Vector3d>& predicted,
                                const std::vector<Eigen::Vector3d>& truth, double threshold) {
  if (truth.empty()) throw InputError("", "joints", "the ground truth has no joint");
  AnymateJointScore score;
  if (predicted.size() < 2) {
    score.not_computed = "fewer than 2 predicted joints, which the published evaluation leaves out";
    return score;
  }
  const RowMatrix cost = distances(predicted, truth);
  const Eigen::ArrayXd to_truth = cost.rowwise().minCoeff(), to_predicted = cost.colwise().minCoeff().transpose();
  score.cd = 0.5 * (to_truth.mean() + to_predicted.mean());
  score.precision = (to_truth < threshold).cast<double>().mean();
  score.recall = (to_predicted < threshold).cast<double>().mean();
  score.emd = released_emd(cost);
  return score;
}

Eigen::VectorXd anymate_cross_entropy(const Eigen::MatrixXd& predicted, const Eigen::MatrixXd& truth) {
  check_connectivity(predicted, truth.rows(), "predicted connectivity");
  check_connectivity(truth, truth.rows(), "true connectivity");
  return -(truth.array() * (predicted.array() + 1e-6).log()).rowwise().sum();
}

AnymateConnectivityScore anymate_connectivity(const Eigen::MatrixXd& predicted, const Eigen::MatrixXd& truth) {
  AnymateConnectivityScore score;
  score.cross_entropy = anymate_cross_entropy(predicted, truth).mean();
  const std::vector<Eigen::Index> guess = best_other_joint(predicted), parent = best_other_joint(truth);
  double right = 0, wrong = 0, missed = 0;
  for (Eigen::Index i = 0; i < truth.rows(); ++i) {
    const bool found = linked(parent, i, guess[at(i)]);
    right += found;
    wrong += !found;
    missed += !linked(guess, i, parent[at(i)]);
  }
  score.precision = right / (right + wrong);
  score.recall = right + missed > 0 ? right / (right + missed) : 0.0;
  return score;
}

MetricSkeleton puppeteer_cleaned(const MetricSkeleton& skeleton) {
  JointGraph graph{skeleton.positions, {}};
  const int root = roots(skeleton).front();
  const std::vector<int> name = representatives(graph.joints, root);
  for (const geometry::Bone& bone : skeleton.bones) graph.bones.push_back({bone.parent, bone.joint});
  graph.bones = renamed(graph.bones, name);
  std::vector<char> keep(graph.joints.size(), 0);
  if (graph.bones.empty()) {
    for (const int j : name) keep[at(j)] = 1;
    graph = compacted(graph, keep);
  } else {
    for (const auto& [parent, child] : graph.bones) keep[at(parent)] = keep[at(child)] = 1;
    keep[at(name[at(root)])] = 1;
    graph = with_components_connected(compacted(graph, keep));
  }
  return MetricSkeleton::graph(std::move(graph.joints), graph.bones);
}

}  // namespace anigen::metrics
