#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/geometry/mesh_check.h"
#include "anigen/geometry/triangle_tree.h"

namespace anigen::geometry {

/// Named, since members of PlainTree are made of them.
namespace plain_tree {

struct FloatBox {
  Eigen::Array3f low = Eigen::Array3f::Constant(std::numeric_limits<float>::infinity());
  Eigen::Array3f high = Eigen::Array3f::Constant(-std::numeric_limits<float>::infinity());

  void extend(const FloatBox& other) {
    low = low.min(other.low);
    high = high.max(other.high);
  }
  void extend(const Eigen::Array3f& point) {
    low = low.min(point);
    high = high.max(point);
  }
  double half_area() const {
    const Eigen::Array3d side = (high - low).cast<double>();
    return side[0] * side[1] + side[1] * side[2] + side[2] * side[0];
  }
};

/// A leaf holds the triangles [first, first + count); an inner node, whose count is 0, has the children first and
/// first + 1.
struct BoxNode {
  FloatBox box;
  std::uint32_t first = 0, count = 0;
};

struct Corners {
  Eigen::Vector3f a, b, c;
  std::uint32_t face;
};

}  // namespace plain_tree

namespace {

using plain_tree::BoxNode;
using plain_tree::Corners;
using plain_tree::FloatBox;

constexpr std::uint32_t kBins = 16;
constexpr std::uint32_t kMostInLeaf = 8;  ///< faces; more are always split
/// Below it the heuristic decides, deeper nodes are halved: no mesh makes the tree deeper than kMostDepth.
constexpr int kHeuristicDepth = 64, kMostDepth = 128;
constexpr double kStep = 1.2;  ///< cost of going down one node, in tests of a triangle

class TreeBuilder {
 public:
  TreeBuilder(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces)
      : vertices_(vertices), faces_(faces) {
    boxes_.reserve(faces.size());
    for (const Triangle& face : faces) {
      FloatBox box;
      for (const std::int32_t corner : face) box.extend(vertices[at(corner)].array());
      boxes_.push_back(box);
    }
    order_.resize(faces.size());
    for (std::size_t i = 0; i < order_.size(); ++i) order_[i] = static_cast<std::uint32_t>(i);
  }

  void build(std::vector<BoxNode>& nodes, std::vector<Corners>& triangles) {
    nodes.emplace_back();
    std::vector<Range> open = {{0, 0, static_cast<std::uint32_t>(order_.size()), 0}};
    while (!open.empty()) {
      const Range range = open.back();
      open.pop_back();
      for (std::uint32_t i = 0; i < range.count; ++i) nodes[range.node].box.extend(boxes_[order_[range.first + i]]);
      const std::uint32_t left = split(range, nodes[range.node].box);
      if (left == 0) {
        nodes[range.node].first = range.first;
        nodes[range.node].count = range.count;
        continue;
      }
      const auto child = static_cast<std::uint32_t>(nodes.size());
      nodes[range.node].first = child;
      nodes.resize(nodes.size() + 2);
      open.push_back({child, range.first, left, range.depth + 1});
      open.push_back({child + 1, range.first + left, range.count - left, range.depth + 1});
    }
    triangles.reserve(order_.size());
    for (const std::uint32_t face : order_) {
      const Triangle& t = faces_[face];
      triangles.push_back({vertices_[at(t[0])], vertices_[at(t[1])], vertices_[at(t[2])], face});
    }
  }

 private:
  struct Range {
    std::uint32_t node, first, count;
    int depth;
  };
  struct Bin {
    FloatBox box;
    std::uint32_t count = 0;
  };

  double middle(std::uint32_t face, int axis) const {
    return 0.5 * (static_cast<double>(boxes_[face].low[axis]) + static_cast<double>(boxes_[face].high[axis]));
  }

  /// Orders the faces of a range into two parts. @return size of the first one; 0 when the range stays a leaf
  std::uint32_t split(const Range& range, const FloatBox& around) {
    if (range.count <= 2) return 0;
    const auto begin = order_.begin() + static_cast<std::ptrdiff_t>(range.first);
    const auto end = begin + static_cast<std::ptrdiff_t>(range.count);
    std::array<double, 3> low, high;
    low.fill(std::numeric_limits<double>::infinity());
    high.fill(-std::numeric_limits<double>::infinity());
    for (auto face = begin; face != end; ++face) {
      for (int axis = 0; axis < 3; ++axis) {
        const double value = middle(*face, axis);
        low[at(axis)] = std::min(low[at(axis)], value);
        high[at(axis)] = std::max(high[at(axis)], value);
      }
    }
    double best_cost = std::numeric_limits<double>::infinity();
    int best_axis = -1;
    std::uint32_t best_bin = 0;
    for (int axis = 0; axis < 3 && range.depth < kHeuristicDepth; ++axis) {
      const double scale = kBins / (high[at(axis)] - low[at(axis)]);
      if (!std::isfinite(scale)) continue;
      std::array<Bin, kBins> bins;
      for (auto face = begin; face != end; ++face) {
        Bin& bin = bins[bin_of(middle(*face, axis), low[at(axis)], scale)];
        bin.box.extend(boxes_[*face]);
        ++bin.count;
      }
      std::array<double, kBins> costs_left{};
      Bin sum;
      for (std::uint32_t b = 0; b + 1 < kBins; ++b) {
        add(sum, bins[b]);
        costs_left[b] = cost(sum);
      }
      sum = Bin();
      for (std::uint32_t b = kBins - 1; b > 0; --b) {
        add(sum, bins[b]);
        const double both = costs_left[b - 1] + cost(sum);
        if (both >= best_cost) continue;
        best_cost = both;
        best_axis = axis;
        best_bin = b;
      }
    }
    const double area = around.half_area();
    const bool leaf_is_cheaper = best_axis >= 0 && best_cost + kStep * area >= range.count * area;
    if (range.count <= kMostInLeaf && (best_axis < 0 || leaf_is_cheaper)) return 0;
    if (best_axis >= 0) {
      const double from = low[at(best_axis)], scale = kBins / (high[at(best_axis)] - from);
      const auto part = std::partition(
          begin, end, [&](std::uint32_t face) { return bin_of(middle(face, best_axis), from, scale) < best_bin; });
      if (part != begin && part != end) return static_cast<std::uint32_t>(part - begin);
    }
    // Faces that lie about one point, or a tree that has grown too deep.
    int widest = 0;
    for (int axis = 1; axis < 3; ++axis) {
      if (high[at(axis)] - low[at(axis)] > high[at(widest)] - low[at(widest)]) widest = axis;
    }
    const std::uint32_t half = range.count / 2;
    std::nth_element(begin, begin + static_cast<std::ptrdiff_t>(half), end, [&](std::uint32_t a, std::uint32_t b) {
      return std::pair(middle(a, widest), a) < std::pair(middle(b, widest), b);
    });
    return half;
  }

  static std::uint32_t bin_of(double value, double low, double scale) {
    return std::min(kBins - 1, static_cast<std::uint32_t>((value - low) * scale));
  }
  static void add(Bin& sum, const Bin& bin) {
    if (bin.count == 0) return;
    sum.box.extend(bin.box);
    sum.count += bin.count;
  }
  static double cost(const Bin& bin) { return bin.count == 0 ? 0.0 : bin.count * bin.box.half_area(); }

  const std::vector<Eigen::Vector3f>& vertices_;
  const std::vector<Triangle>& faces_;
  std::vector<FloatBox> boxes_;
  std::vector<std::uint32_t> order_;
};

/// A ray set up for tests of boxes and triangles.
class RayTest {
 public:
  explicit RayTest(const TreeRay& ray)
      : origin_(ray.origin.cast<double>()), nearest_(ray.nearest), farthest_(ray.farthest) {
    const Eigen::Vector3d direction = ray.direction.cast<double>();
    // Finite, so that no product is 0 times infinity.
    constexpr double kSmallest = 1e-300;
    for (int axis = 0; axis < 3; ++axis)
      inverse_[axis] = 1.0 / (std::abs(direction[axis]) < kSmallest ? kSmallest : direction[axis]);
    direction.cwiseAbs().maxCoeff(&z_);
    x_ = (z_ + 1) % 3;
    y_ = (z_ + 2) % 3;
    if (direction[z_] < 0.0) std::swap(x_, y_);
    shear_x_ = direction[x_] / direction[z_];
    shear_y_ = direction[y_] / direction[z_];
    shear_z_ = 1.0 / direction[z_];
  }

  /// Distance at which the ray enters a box; infinity when it does not, or only beyond `farthest`.
  double enters(const FloatBox& box) const {
    const Eigen::Array3d a = (box.low.cast<double>() - origin_.array()) * inverse_;
    const Eigen::Array3d b = (box.high.cast<double>() - origin_.array()) * inverse_;
    const double in = std::max(a.min(b).maxCoeff(), nearest_), out = std::min(a.max(b).minCoeff(), farthest_);
    // A few roundings wider than the box.
    constexpr double kRounding = 1e-15;
    const bool meets = in - kRounding * std::abs(in) <= out + kRounding * std::abs(out);
    return meets ? in : std::numeric_limits<double>::infinity();
  }

  /// Shortens the ray to its hit. False on a miss.
  bool hits(const Corners& triangle, TreeHit& hit) {
    const Eigen::Vector3d a = triangle.a.cast<double>() - origin_, b = triangle.b.cast<double>() - origin_,
                          c = triangle.c.cast<double>() - origin_;
    const double ax = a[x_] - shear_x_ * a[z_], ay = a[y_] - shear_y_ * a[z_];
    const double bx = b[x_] - shear_x_ * b[z_], by = b[y_] - shear_y_ * b[z_];
    const double cx = c[x_] - shear_x_ * c[z_], cy = c[y_] - shear_y_ * c[z_];
    // Twice the areas opposite the corners: of neighbours they differ in sign alone, so that no ray slips through.
    const double at_a = cx * by - cy * bx, at_b = ax * cy - ay * cx, at_c = bx * ay - by * ax;
    if ((at_a < 0.0 || at_b < 0.0 || at_c < 0.0) && (at_a > 0.0 || at_b > 0.0 || at_c > 0.0)) return false;
    const double sum = at_a + at_b + at_c;
    if (sum == 0.0) return false;
    const double distance = shear_z_ * (at_a * a[z_] + at_b * b[z_] + at_c * c[z_]) / sum;
    if (!(distance > nearest_ && distance <= farthest_)) return false;
    farthest_ = distance;
    hit = {triangle.face, static_cast<float>(distance), static_cast<float>(at_b / sum), static_cast<float>(at_c / sum)};
    return true;
  }

  double farthest() const { return farthest_; }

 private:
  Eigen::Vector3d origin_;
  Eigen::Array3d inverse_;
  double nearest_, farthest_;
  double shear_x_, shear_y_, shear_z_;
  int x_, y_, z_ = 0;
};

double squared_distance(const FloatBox& box, const Eigen::Array3d& point) {
  const Eigen::Array3d outside = (box.low.cast<double>() - point).max(point - box.high.cast<double>()).max(0.0);
  return outside.matrix().squaredNorm();
}

struct Waiting {
  std::uint32_t node;
  double at;  ///< of the ray, or squared distance
};

}  // namespace

struct PlainTree::Nodes {
  std::vector<plain_tree::BoxNode> nodes;
  std::vector<plain_tree::Corners> triangles;

  template <bool kAny>
  TreeHit trace(const TreeRay& ray) const {
    TreeHit hit;
    if (triangles.empty()) return hit;
    RayTest test(ray);
    std::array<Waiting, kMostDepth> waiting;
    std::size_t count = 0;
    const double first = test.enters(nodes[0].box);
    if (std::isfinite(first)) waiting[count++] = {0, first};
    while (count > 0) {
      const Waiting next = waiting[--count];
      if (next.at > test.farthest()) continue;
      const BoxNode& node = nodes[next.node];
      if (node.count > 0) {
        for (std::uint32_t i = 0; i < node.count; ++i) {
          if (test.hits(triangles[node.first + i], hit) && kAny) return hit;
        }
        continue;
      }
      Waiting near{node.first, test.enters(nodes[node.first].box)};
      Waiting far{node.first + 1, test.enters(nodes[node.first + 1].box)};
      if (far.at < near.at) std::swap(near, far);
      if (std::isfinite(far.at)) waiting[count++] = far;
      if (std::isfinite(near.at)) waiting[count++] = near;
    }
    return hit;
  }
};

PlainTree::PlainTree(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces)
    : nodes_(std::make_unique<Nodes>()) {
  check_mesh(vertices, faces);
  TreeBuilder(vertices, faces).build(nodes_->nodes, nodes_->triangles);
}

PlainTree::~PlainTree() = default;

TreeHit PlainTree::first_hit(const TreeRay& ray) const { return nodes_->trace<false>(ray); }

BundleHits PlainTree::first_hits(const Eigen::Vector3f& origin, const RayBundle& directions) const {
  BundleHits hits;
  for (std::size_t i = 0; i < directions.size(); ++i) hits[i] = first_hit({origin, directions[i]});
  return hits;
}

bool PlainTree::is_blocked(const TreeRay& ray) const { return nodes_->trace<true>(ray).found(); }

void PlainTree::visit_within(const Eigen::Vector3d& point, float radius, VisitFace visit, void* data) const {
  if (nodes_->triangles.empty()) return;
  // In single precision, as Embree sees it: callers allow for that rounding.
  const Eigen::Array3d from = point.cast<float>().cast<double>().array();
  const std::vector<BoxNode>& nodes = nodes_->nodes;
  std::array<Waiting, kMostDepth> waiting;
  std::size_t count = 0;
  const auto within = [&radius](double squared) {
    const auto reach = static_cast<double>(radius);
    return squared <= reach * reach;
  };
  waiting[count++] = {0, squared_distance(nodes[0].box, from)};
  while (count > 0) {
    const Waiting next = waiting[--count];
    if (!within(next.at)) continue;
    const BoxNode& node = nodes[next.node];
    if (node.count > 0) {
      for (std::uint32_t i = 0; i < node.count; ++i)
        radius = std::min(radius, visit(data, nodes_->triangles[node.first + i].face, radius));
      continue;
    }
    Waiting near{node.first, squared_distance(nodes[node.first].box, from)};
    Waiting far{node.first + 1, squared_distance(nodes[node.first + 1].box, from)};
    if (far.at < near.at) std::swap(near, far);
    if (within(far.at)) waiting[count++] = far;
    if (within(near.at)) waiting[count++] = near;
  }
}

}  // namespace anigen::geometry
