#include "anigen/rig/curve/curve_tree.h"

#include <algorithm>
#include <numeric>
#include <tuple>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::rig {
namespace {

class CurveSets {
 public:
  explicit CurveSets(std::size_t n) : root_(n) { std::iota(root_.begin(), root_.end(), 0); }
  int find(int v) {
    while (root_[at(v)] != v) v = root_[at(v)] = root_[at(root_[at(v)])];
    return v;
  }
  bool join(int a, int b) {
    a = find(a);
    b = find(b);
    root_[at(b)] = a;
    return a != b;
  }

 private:
  std::vector<int> root_;
};

double apart(const CurveTree& tree, int a, int b) { return (tree.points[at(a)] - tree.points[at(b)]).norm(); }

void link(CurveTree& tree, int a, int b) {
  tree.neighbours[at(a)].push_back(b);
  tree.neighbours[at(b)].push_back(a);
}

/// The points that are marked, with the links between them.
CurveTree kept_points(const CurveTree& tree, const std::vector<char>& kept) {
  std::vector<int> number(tree.size(), -1);
  CurveTree result;
  for (std::size_t p = 0; p < tree.size(); ++p) {
    if (kept[p] == 0) continue;
    number[p] = static_cast<int>(result.size());
    result.points.push_back(tree.points[p]);
    result.radii.push_back(tree.radii[p]);
  }
  result.neighbours.resize(result.size());
  for (std::size_t p = 0; p < tree.size(); ++p) {
    if (kept[p] == 0) continue;
    for (const int q : tree.neighbours[p]) {
      if (kept[at(q)] != 0) result.neighbours[at(number[p])].push_back(number[at(q)]);
    }
  }
  return result;
}

/// From an end of the curve to the point before the next branching one.
struct Spur {
  std::vector<int> points;
  int branch = -1;
  double reach = 0.0;  ///< distance from the branch to its farthest point: knots have length but get nowhere
};

Spur spur_at(const CurveTree& tree, int end) {
  Spur spur;
  int before = -1, here = end;
  while (tree.degree(here) <= 2) {
    spur.points.push_back(here);
    int next = -1;
    for (const int q : tree.neighbours[at(here)]) {
      if (q != before) next = q;
    }
    if (next < 0) return spur;  // the other end
    before = here;
    here = next;
  }
  spur.branch = here;
  for (const int p : spur.points) spur.reach = std::max(spur.reach, apart(tree, p, here));
  return spur;
}

}  // namespace

CurveTree curve_tree(const std::vector<Eigen::Vector3d>& points, const std::vector<double>& radii,
                     const std::vector<std::array<int, 2>>& edges) {
  CurveTree tree;
  tree.points = points;
  tree.radii = radii;
  tree.neighbours.resize(points.size());
  CurveSets sets(points.size());
  std::vector<std::tuple<double, int, int>> order;
  for (const auto& [a, b] : edges) order.emplace_back(-std::min(radii[at(a)], radii[at(b)]), a, b);
  std::sort(order.begin(), order.end());
  for (const auto& [thin, a, b] : order) {
    if (sets.join(a, b)) link(tree, a, b);
  }
  std::vector<std::tuple<double, int, int>> gaps;
  for (int a = 0; at(a) < points.size(); ++a) {
    for (int b = a + 1; at(b) < points.size(); ++b) {
      if (sets.find(a) != sets.find(b)) gaps.emplace_back(apart(tree, a, b), a, b);
    }
  }
  std::sort(gaps.begin(), gaps.end());
  for (const auto& [gap, a, b] : gaps) {
    if (sets.join(a, b)) link(tree, a, b);
  }
  for (auto& list : tree.neighbours) std::sort(list.begin(), list.end());
  return tree;
}

CurveTree without_spurs(CurveTree tree, double radii, double length) {
  while (true) {
    Spur shortest;
    for (int p = 0; at(p) < tree.size(); ++p) {
      if (tree.degree(p) != 1) continue;
      Spur spur = spur_at(tree, p);
      if (spur.branch < 0) continue;
      if (!(spur.reach < std::max(length, radii * tree.radii[at(spur.branch)]))) continue;
      if (shortest.branch < 0 || spur.reach < shortest.reach) shortest = std::move(spur);
    }
    if (shortest.branch < 0) return tree;
    std::vector<char> kept(tree.size(), 1);
    for (const int p : shortest.points) kept[at(p)] = 0;
    tree = kept_points(tree, kept);
  }
}

CurveTree with_joined_branches(CurveTree tree, double radii) {
  while (true) {
    // The two neighbouring branching points that are nearest to each other for their size.
    std::vector<int> nearest;
    double least = radii;
    for (int p = 0; at(p) < tree.size(); ++p) {
      if (tree.degree(p) < 3) continue;
      for (const int first : tree.neighbours[at(p)]) {
        std::vector<int> way{p};
        double length = 0.0;
        for (int before = p, here = first;;) {
          length += apart(tree, before, here);
          way.push_back(here);
          if (tree.degree(here) != 2) break;
          const auto& around = tree.neighbours[at(here)];
          const int next = around[0] == before ? around[1] : around[0];
          before = here;
          here = next;
        }
        const int q = way.back();
        if (tree.degree(q) < 3 || q < p) continue;
        const double relative = length / std::max({tree.radii[at(p)], tree.radii[at(q)], 1e-12});
        if (!(relative < least)) continue;
        least = relative;
        nearest = way;
      }
    }
    if (nearest.empty()) return tree;
    const int p = nearest.front(), q = nearest.back();
    const double rp = tree.radii[at(p)], rq = tree.radii[at(q)];
    tree.points[at(p)] = (rp * tree.points[at(p)] + rq * tree.points[at(q)]) / std::max(rp + rq, 1e-12);
    tree.radii[at(p)] = std::max(rp, rq);
    std::vector<char> kept(tree.size(), 1);
    for (std::size_t i = 1; i < nearest.size(); ++i) kept[at(nearest[i])] = 0;
    for (const int other : std::vector<int>(tree.neighbours[at(q)])) {
      if (other == nearest[nearest.size() - 2]) continue;
      link(tree, p, other);
    }
    tree = kept_points(tree, kept);
    for (auto& list : tree.neighbours) std::sort(list.begin(), list.end());
  }
}

}  // namespace anigen::rig
