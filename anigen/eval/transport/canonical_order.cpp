#include "anigen/eval/transport/canonical_order.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include "anigen/core/numeric.h"

namespace anigen::eval {
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

// The same tree hung from another node.
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

std::vector<double> joined(std::vector<double> x, const double* begin, const double* end) {
  x.insert(x.end(), begin, end);
  return x;
}

}  // namespace

CanonicalOrder canonical_order(const LabelledTree& first, const LabelledTree& second) {
  const auto& m1 = first.masses;
  const auto& m2 = second.masses;
  const Classes lengths(
      joined(first.tree.lengths, second.tree.lengths.data(), second.tree.lengths.data() + second.tree.lengths.size()));
  const Classes masses(joined(std::vector<double>(m1.data(), m1.data() + m1.size()), m2.data(), m2.data() + m2.size()));
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

}  // namespace anigen::eval
