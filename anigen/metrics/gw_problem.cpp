#include "anigen/metrics/gw_problem.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::metrics {

MetricTree bone_tree(const JointTree& forest) {
  const JointTree tree = connected(forest);
  MetricTree result{tree.parents, std::vector<double>(tree.size(), 0.0), parents_first(tree)};
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (tree.parents[j] >= 0) result.lengths[j] = (tree.positions[j] - tree.positions[at(tree.parents[j])]).norm();
  }
  return result;
}

Eigen::MatrixXd tree_geodesics(const JointTree& tree) {
  check(tree, "");
  return path_lengths(bone_tree(tree));
}

std::optional<MetricTree> metric_tree(const Eigen::MatrixXd& distances) {
  const int n = static_cast<int>(distances.rows());
  MetricTree tree{std::vector<int>(at(n), -1), std::vector<double>(at(n), 0.0), {0}};
  // Prim's algorithm: `nearest` is the tree node closest to a node still outside.
  std::vector<double> gap(at(n), std::numeric_limits<double>::infinity());
  std::vector<int> nearest(at(n), 0);
  std::vector<char> inside(at(n), 0);
  inside[0] = 1;
  // Among joints at one place the first to come in stands for all, so that the tree does not depend on their labels.
  const double largest = distances.maxCoeff(), coincident = 1e-12 * largest;
  for (int last = 0; static_cast<int>(tree.order.size()) < n;) {
    int next = -1;
    for (int j = 0; j < n; ++j) {
      if (inside[at(j)]) continue;
      if (distances(j, last) < gap[at(j)] - coincident) gap[at(j)] = distances(j, last), nearest[at(j)] = last;
      if (next < 0 || gap[at(j)] < gap[at(next)]) next = j;
    }
    inside[at(next)] = 1;
    tree.parents[at(next)] = nearest[at(next)];
    tree.lengths[at(next)] = gap[at(next)];
    tree.order.push_back(next);
    last = next;
  }
  if ((path_lengths(tree) - distances).cwiseAbs().maxCoeff() > 1e-10 * largest) return std::nullopt;
  return tree;
}

Eigen::MatrixXd path_lengths(const MetricTree& tree) {
  const Eigen::Index n = static_cast<Eigen::Index>(tree.parents.size());
  Eigen::MatrixXd distances = Eigen::MatrixXd::Zero(n, n);
  for (std::size_t k = 1; k < tree.order.size(); ++k) {
    const int node = tree.order[k], parent = tree.parents[at(node)];
    const double length = tree.lengths[at(node)];
    for (std::size_t l = 0; l < k; ++l) {
      const int other = tree.order[l];
      distances(other, node) = distances(node, other) = distances(other, parent) + length;
    }
  }
  return distances;
}

RowMatrix multiply(const MetricTree& tree, const RowMatrix& values) {
  // Sums over subtrees, then from the root downwards: crossing an edge brings the subtree nearer and all else farther.
  RowMatrix below = values;
  const std::size_t n = tree.order.size();
  for (std::size_t k = n; k-- > 1;) below.row(tree.parents[at(tree.order[k])]) += below.row(tree.order[k]);
  const int root = tree.order[0];
  RowMatrix result(values.rows(), values.cols());
  result.row(root).setZero();
  for (std::size_t k = 1; k < n; ++k) result.row(root) += tree.lengths[at(tree.order[k])] * below.row(tree.order[k]);
  for (std::size_t k = 1; k < n; ++k) {
    const int node = tree.order[k];
    result.row(node) =
        result.row(tree.parents[at(node)]) + tree.lengths[at(node)] * (below.row(root) - 2.0 * below.row(node));
  }
  return result;
}

MetricTree renumbered(const MetricTree& tree, const std::vector<int>& order) {
  const std::size_t n = order.size();
  std::vector<int> position(n);
  for (std::size_t k = 0; k < n; ++k) position[at(order[k])] = static_cast<int>(k);
  MetricTree result{std::vector<int>(n), std::vector<double>(n), {}};
  for (std::size_t k = 0; k < n; ++k) {
    const int parent = tree.parents[at(order[k])];
    result.parents[k] = parent < 0 ? -1 : position[at(parent)];
    result.lengths[k] = tree.lengths[at(order[k])];
  }
  for (const int node : tree.order) result.order.push_back(position[at(node)]);
  return result;
}

RowMatrix GwProblem::gradient(const std::vector<PlanCell>& cells) const {
  RowMatrix moved = RowMatrix::Zero(rows(), columns());
  for (const PlanCell& cell : cells) moved.row(cell.row) += cell.mass * c2.row(cell.column);
  RowMatrix result = tree1 ? multiply(*tree1, moved) : RowMatrix(c1 * moved);
  result *= -2.0 * curvature;
  if (linear.size() > 0) result += linear;
  return result;
}

double GwProblem::objective(const std::vector<PlanCell>& cells, const RowMatrix& gradient) const {
  double sum = 0.0;
  for (const PlanCell& cell : cells)
    sum += cell.mass * (gradient(cell.row, cell.column) + (linear.size() > 0 ? linear(cell.row, cell.column) : 0.0));
  return 0.5 * sum;
}

double GwProblem::resolution() const {
  const double total = static_cast<double>(units.total);
  const double quadratic = curvature * total * c1.maxCoeff() * c2.maxCoeff();
  const double largest = linear.size() > 0 ? linear.cwiseAbs().maxCoeff() : 0.0;
  return 1e-12 * total * (quadratic + largest);
}

double gw_cost(const RowMatrix& c1, const RowMatrix& c2, const std::vector<PlanCell>& cells) {
  double sum = 0.0;
  for (std::size_t e = 0; e < cells.size(); ++e) {
    const double* d1 = c1.row(cells[e].row).data();
    const double* d2 = c2.row(cells[e].column).data();
    double inner = 0.0;
    for (std::size_t f = 0; f < e; ++f) {
      const double difference = d1[cells[f].row] - d2[cells[f].column];
      inner += cells[f].mass * difference * difference;
    }
    sum += 2.0 * cells[e].mass * inner;
  }
  return sum;
}

double gw_cost(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::MatrixXd& plan) {
  const Eigen::VectorXd rows = plan.rowwise().sum(), columns = plan.colwise().sum();
  const double squares = rows.dot(c1.cwiseAbs2() * rows) + columns.dot(c2.cwiseAbs2() * columns);
  return std::max(0.0, squares - 2.0 * (c1 * plan * c2).cwiseProduct(plan).sum());
}

namespace {

constexpr double kSame = 1e-9;

// Numbers that differ by rounding only fall into one class; classes are numbered upwards.
class Classes {
 public:
  explicit Classes(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const double tolerance = values.empty() ? 0.0 : kSame * std::abs(values.back());
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (i == 0 || values[i] - values[i - 1] > tolerance) starts_.push_back(values[i]);
    }
  }
  int operator()(double value) const {
    return static_cast<int>(std::upper_bound(starts_.begin(), starts_.end(), value) - starts_.begin());
  }

 private:
  std::vector<double> starts_;
};

struct Code {
  std::vector<int> shape;       // classes and child counts of the subtree in preorder
  std::vector<double> numbers;  // lengths, masses and positions in the same order
  bool operator<(const Code& other) const { return std::tie(shape, numbers) < std::tie(other.shape, other.numbers); }
};

struct Rooted {
  Code code;
  std::vector<int> order;
  MetricTree tree;  // rooted at order[0], not renumbered
};

// Hangs a tree from another node.
MetricTree rerooted(const MetricTree& tree, int root) {
  const std::size_t n = tree.parents.size();
  std::vector<std::vector<std::pair<int, double>>> neighbours(n);
  for (std::size_t j = 0; j < n; ++j) {
    if (tree.parents[j] < 0) continue;
    neighbours[j].emplace_back(tree.parents[j], tree.lengths[j]);
    neighbours[at(tree.parents[j])].emplace_back(static_cast<int>(j), tree.lengths[j]);
  }
  MetricTree result{std::vector<int>(n, -1), std::vector<double>(n, 0.0), {root}};
  for (std::size_t k = 0; k < result.order.size(); ++k) {
    const int node = result.order[k];
    for (const auto& [other, length] : neighbours[at(node)]) {
      if (other == result.parents[at(node)]) continue;
      result.parents[at(other)] = node;
      result.lengths[at(other)] = length;
      result.order.push_back(other);
    }
  }
  return result;
}

Rooted rooted_code(const LabelledTree& labelled, int root, const Classes& lengths, const Classes& masses) {
  Rooted result;
  result.tree = rerooted(labelled.tree, root);
  const MetricTree& tree = result.tree;
  const std::size_t n = tree.order.size();
  std::vector<std::vector<int>> children(n);
  std::vector<Code> codes(n);
  for (std::size_t k = n; k-- > 0;) {
    const int node = tree.order[k];
    std::vector<int>& below = children[at(node)];
    std::sort(below.begin(), below.end(), [&](int x, int y) { return codes[at(x)] < codes[at(y)]; });
    Code& code = codes[at(node)];
    code.shape = {k == 0 ? 0 : lengths(tree.lengths[at(node)]), masses(labelled.masses[node]),
                  static_cast<int>(below.size())};
    code.numbers = {tree.lengths[at(node)], labelled.masses[node]};
    for (const int child : below) {
      const Code& inner = codes[at(child)];
      code.shape.insert(code.shape.end(), inner.shape.begin(), inner.shape.end());
      code.numbers.insert(code.numbers.end(), inner.numbers.begin(), inner.numbers.end());
    }
    // Positions last: they must not decide before any length does.
    if (!labelled.positions.empty()) {
      const Eigen::Vector3d& p = labelled.positions[at(node)];
      code.numbers.insert(code.numbers.end(), {p.x(), p.y(), p.z()});
    }
    if (k > 0) children[at(tree.parents[at(node)])].push_back(node);
  }
  std::vector<int> stack = {root};
  while (!stack.empty()) {
    const int node = stack.back();
    stack.pop_back();
    result.order.push_back(node);
    stack.insert(stack.end(), children[at(node)].rbegin(), children[at(node)].rend());
  }
  result.code = std::move(codes[at(root)]);
  return result;
}

Rooted canonical(const LabelledTree& labelled, const Classes& lengths, const Classes& masses) {
  RowMatrix mass = labelled.masses;
  const RowMatrix remoteness = multiply(labelled.tree, mass);
  const double least = remoteness.minCoeff(), tolerance = kSame * remoteness.maxCoeff();
  Rooted best;
  for (Eigen::Index j = 0; j < remoteness.rows(); ++j) {
    if (remoteness(j, 0) > least + tolerance) continue;
    Rooted candidate = rooted_code(labelled, static_cast<int>(j), lengths, masses);
    if (best.order.empty() || candidate.code < best.code) best = std::move(candidate);
  }
  return best;
}

}  // namespace

CanonicalOrder canonical_order(const LabelledTree& first, const LabelledTree& second) {
  const auto& m1 = first.masses;
  const auto& m2 = second.masses;
  std::vector<double> all_lengths = first.tree.lengths, all_masses(m1.data(), m1.data() + m1.size());
  all_lengths.insert(all_lengths.end(), second.tree.lengths.begin(), second.tree.lengths.end());
  all_masses.insert(all_masses.end(), m2.data(), m2.data() + m2.size());
  const Classes lengths(std::move(all_lengths)), masses(std::move(all_masses));
  const Rooted one = canonical(first, lengths, masses), two = canonical(second, lengths, masses);
  CanonicalOrder result;
  result.first = one.order;
  result.second = two.order;
  result.first_tree = renumbered(one.tree, one.order);
  result.second_tree = renumbered(two.tree, two.order);
  // Preorder is also an order of parents before children, and does not remember the old labels.
  std::iota(result.first_tree.order.begin(), result.first_tree.order.end(), 0);
  std::iota(result.second_tree.order.begin(), result.second_tree.order.end(), 0);
  result.isomorphic = one.code.shape == two.code.shape;
  return result;
}

}  // namespace anigen::metrics
