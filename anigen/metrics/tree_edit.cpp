#include "anigen/metrics/tree_edit.h"

#include <algorithm>
#include <vector>

#include "anigen/core/numeric.h"

namespace anigen::metrics {

namespace {

using Children = std::vector<std::vector<int>>;

/// Children of every joint by index; the last entry is a root above all roots.
Children children_of(const MetricSkeleton& tree) {
  Children children(tree.size() + 1);
  for (std::size_t j = 0; j < tree.size(); ++j) {
    const int parent = tree.parents[j];
    children[parent < 0 ? tree.size() : at(parent)].push_back(static_cast<int>(j));
  }
  return children;
}

/// Parents before children; reversed, children before parents.
std::vector<int> top_down(const Children& children) {
  std::vector<int> order{static_cast<int>(children.size()) - 1};
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (const int next : children[at(order[i])]) order.push_back(next);
  }
  return order;
}

/// Sorts children by (size, shape), largest first. Shapes are compared through ranks: nodes are taken size by size,
/// and a node's rank is the place of its children's ranks, largest first, among those of its size (the idea of Aho,
/// Hopcroft and Ullman's tree isomorphism). Equal ranks are equal shapes, so their order does not matter.
void sort_canonically(Children& children) {
  const std::vector<int> order = top_down(children);
  std::vector<int> size(children.size(), 1), rank(children.size(), 0);
  for (auto j = order.rbegin(); j != order.rend(); ++j) {
    for (const int child : children[at(*j)]) size[at(*j)] += size[at(child)];
  }
  std::vector<int> by_size(order);
  std::stable_sort(by_size.begin(), by_size.end(), [&](int a, int b) { return size[at(a)] < size[at(b)]; });
  std::vector<std::vector<int>> code(children.size());
  int next_rank = 0;
  for (std::size_t begin = 0; begin < by_size.size();) {
    std::size_t end = begin;
    while (end < by_size.size() && size[at(by_size[end])] == size[at(by_size[begin])]) ++end;
    for (std::size_t i = begin; i < end; ++i) {
      std::vector<int>& mine = children[at(by_size[i])];
      std::stable_sort(mine.begin(), mine.end(), [&](int a, int b) { return rank[at(a)] > rank[at(b)]; });
      for (const int child : mine) code[at(by_size[i])].push_back(rank[at(child)]);
    }
    const auto first = by_size.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto last = by_size.begin() + static_cast<std::ptrdiff_t>(end);
    std::stable_sort(first, last, [&](int a, int b) { return code[at(a)] < code[at(b)]; });
    for (std::size_t i = begin; i < end; ++i) {
      if (i > begin && code[at(by_size[i])] != code[at(by_size[i - 1])]) ++next_rank;
      rank[at(by_size[i])] = next_rank;
    }
    ++next_rank;
    begin = end;
  }
}

/// A tree as Zhang and Shasha read it: nodes in postorder.
struct Postorder {
  std::vector<int> leftmost;  ///< postorder number of the leftmost leaf below each node
  std::vector<int> keyroots;  ///< nodes with a left sibling, and the root; ascending
  double work = 0;            ///< Σ over keyroots of the size of their subtree

  explicit Postorder(const Children& children) {
    struct Frame {
      int node, next_child, leftmost;
    };
    std::vector<Frame> stack{{static_cast<int>(children.size()) - 1, 0, -1}};
    while (!stack.empty()) {
      Frame& frame = stack.back();
      const std::vector<int>& mine = children[at(frame.node)];
      if (at(frame.next_child) < mine.size()) {
        stack.push_back({mine[at(frame.next_child++)], 0, -1});
        continue;
      }
      const int number = static_cast<int>(leftmost.size());
      const int leaf = frame.leftmost < 0 ? number : frame.leftmost;
      leftmost.push_back(leaf);
      stack.pop_back();
      if (!stack.empty() && stack.back().leftmost < 0) stack.back().leftmost = leaf;
    }
    // The last node of each leftmost leaf is its keyroot.
    std::vector<char> taken(leftmost.size(), 0);
    for (int i = static_cast<int>(leftmost.size()) - 1; i >= 0; --i) {
      if (taken[at(leftmost[at(i)])]) continue;
      taken[at(leftmost[at(i)])] = 1;
      keyroots.push_back(i);
      work += i - leftmost[at(i)] + 1;
    }
    std::reverse(keyroots.begin(), keyroots.end());
  }
};

int distance(const Postorder& a, const Postorder& b) {
  const std::size_t n = a.leftmost.size(), m = b.leftmost.size();
  std::vector<int> tree(n * m), forest((n + 1) * (m + 1));
  for (const int ka : a.keyroots) {
    for (const int kb : b.keyroots) {
      const int la = a.leftmost[at(ka)], lb = b.leftmost[at(kb)];
      const std::size_t rows = at(ka - la) + 2, columns = at(kb - lb) + 2;
      for (std::size_t j = 0; j < columns; ++j) forest[j] = static_cast<int>(j);
      for (std::size_t i = 1; i < rows; ++i) {
        int* row = forest.data() + i * columns;
        const int* above = row - columns;
        row[0] = static_cast<int>(i);
        const int node_a = la + static_cast<int>(i) - 1;
        const bool whole_a = a.leftmost[at(node_a)] == la;
        const int* before_a = forest.data() + at(a.leftmost[at(node_a)] - la) * columns;
        for (std::size_t j = 1; j < columns; ++j) {
          const int node_b = lb + static_cast<int>(j) - 1;
          const int edit = std::min(above[j], row[j - 1]) + 1;
          int& known = tree[at(node_a) * m + at(node_b)];
          if (whole_a && b.leftmost[at(node_b)] == lb) {
            known = row[j] = std::min(edit, above[j - 1]);  // both are whole trees: match the two nodes
          } else {
            row[j] = std::min(edit, before_a[b.leftmost[at(node_b)] - lb] + known);
          }
        }
      }
    }
  }
  return tree.back();
}

void mirror(Children& children) {
  for (std::vector<int>& list : children) std::reverse(list.begin(), list.end());
}

}  // namespace

std::optional<int> tree_edit_distance(const MetricSkeleton& a, const MetricSkeleton& b, ChildOrder order) {
  if (static_cast<double>(a.size() + 2) * static_cast<double>(b.size() + 2) > kMostTreeEditPairs) return std::nullopt;
  Children children_a = children_of(a), children_b = children_of(b);
  if (order == ChildOrder::kCanonical) {
    sort_canonically(children_a);
    sort_canonically(children_b);
  }
  // The mirror images of both trees are as far apart, and one way round can be far less work.
  const Postorder left_a(children_a), left_b(children_b);
  mirror(children_a);
  mirror(children_b);
  const Postorder right_a(children_a), right_b(children_b);
  const double left = left_a.work * left_b.work, right = right_a.work * right_b.work;
  if (std::min(left, right) > kMostTreeEditSteps) return std::nullopt;
  return left <= right ? distance(left_a, left_b) : distance(right_a, right_b);
}

}  // namespace anigen::metrics
