#include "anigen/metrics/shell_gaps.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <tuple>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::metrics {

/// Boxes of the faces of a shell, by halves.
struct ShellNode {
  std::int32_t first, last;            // in the order of ShellTree::faces
  std::int32_t left = -1, right = -1;  // nodes; -1: a leaf
};

struct ShellTree {
  std::vector<std::int32_t> faces;  // of the mesh
  std::vector<ShellNode> nodes;     // parents before children, the root first
};

namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr std::int32_t kLeafFaces = 4;
constexpr double kNoGrowth = 1e-6;  // diagonals: rounding of places in single precision

TriangleCorners corners_at(const std::vector<Vector3f>& places, const Triangle& face) {
  return {places[at(face[0])].cast<double>(), places[at(face[1])].cast<double>(), places[at(face[2])].cast<double>()};
}

double distance_of_boxes(const Box& a, const Box& b) {
  return (b.low - a.high).cwiseMax(a.low - b.high).cwiseMax(0.0).norm();
}

/// @param middles of all faces of the mesh
ShellTree grown_tree(std::vector<std::int32_t> faces, const std::vector<Vector3d>& middles) {
  ShellTree tree;
  tree.faces = std::move(faces);
  tree.nodes.push_back({0, static_cast<std::int32_t>(tree.faces.size())});
  for (std::size_t node = 0; node < tree.nodes.size(); ++node) {
    const auto [first, last, left, right] = tree.nodes[node];
    if (last - first <= kLeafFaces) continue;
    Box box;
    for (std::int32_t i = first; i < last; ++i) box.extend(middles[at(tree.faces[at(i)])]);
    int axis = 0;
    (box.high - box.low).maxCoeff(&axis);
    const std::int32_t middle = first + (last - first) / 2;
    std::nth_element(tree.faces.begin() + first, tree.faces.begin() + middle, tree.faces.begin() + last,
                     [&](std::int32_t a, std::int32_t b) {
                       return std::make_pair(middles[at(a)][axis], a) < std::make_pair(middles[at(b)][axis], b);
                     });
    tree.nodes[node].left = static_cast<std::int32_t>(tree.nodes.size());
    tree.nodes[node].right = tree.nodes[node].left + 1;
    tree.nodes.push_back({first, middle});
    tree.nodes.push_back({middle, last});
  }
  return tree;
}

/// Boxes of a tree's nodes with the mesh in a pose.
std::vector<Box> fitted_boxes(const ShellTree& tree, const std::vector<Vector3f>& places,
                              const std::vector<Triangle>& mesh) {
  std::vector<Box> boxes(tree.nodes.size());
  for (std::size_t n = tree.nodes.size(); n-- > 0;) {
    const ShellNode& node = tree.nodes[n];
    if (node.left >= 0) {
      for (const std::int32_t child : {node.left, node.right}) {
        boxes[n].extend(boxes[at(child)].low);
        boxes[n].extend(boxes[at(child)].high);
      }
      continue;
    }
    for (std::int32_t i = node.first; i < node.last; ++i) {
      for (const std::int32_t corner : mesh[at(tree.faces[at(i)])]) boxes[n].extend(places[at(corner)].cast<double>());
    }
  }
  return boxes;
}

struct FacePair {
  double distance = std::numeric_limits<double>::infinity();
  std::int32_t first = -1, second = -1;
};

/// The nearest faces of two shells in a pose.
class PairSearch {
 public:
  PairSearch(const std::vector<Vector3f>& places, const std::vector<Triangle>& mesh) : places_(places), mesh_(mesh) {}

  /// @param found an upper bound to begin with @param enough ends the search once it is reached
  FacePair nearest(const ShellTree& a, const std::vector<Box>& boxes_a, const ShellTree& b,
                   const std::vector<Box>& boxes_b, FacePair found, double enough) const {
    std::vector<std::tuple<double, std::int32_t, std::int32_t>> open{{distance_of_boxes(boxes_a[0], boxes_b[0]), 0, 0}};
    while (!open.empty() && found.distance > enough) {
      const auto [bound, i, j] = open.back();
      open.pop_back();
      if (bound >= found.distance) continue;
      const ShellNode &x = a.nodes[at(i)], &y = b.nodes[at(j)];
      if (x.left < 0 && y.left < 0) {
        compare(a, x, b, y, found);
        continue;
      }
      const bool splits_first = y.left < 0 || (x.left >= 0 && x.last - x.first >= y.last - y.first);
      std::array<std::tuple<double, std::int32_t, std::int32_t>, 2> next;
      for (std::size_t child = 0; child < 2; ++child) {
        const std::int32_t m = !splits_first ? i : child == 0 ? x.left : x.right;
        const std::int32_t n = splits_first ? j : child == 0 ? y.left : y.right;
        next[child] = {distance_of_boxes(boxes_a[at(m)], boxes_b[at(n)]), m, n};
      }
      if (std::get<0>(next[0]) < std::get<0>(next[1])) std::swap(next[0], next[1]);
      for (const auto& entry : next) open.push_back(entry);  // the nearer one is looked at first
    }
    return found;
  }

 private:
  void compare(const ShellTree& a, const ShellNode& x, const ShellTree& b, const ShellNode& y, FacePair& found) const {
    for (std::int32_t i = x.first; i < x.last; ++i) {
      const std::int32_t face = a.faces[at(i)];
      const TriangleCorners first = corners_at(places_, mesh_[at(face)]);
      for (std::int32_t j = y.first; j < y.last; ++j) {
        const std::int32_t other = b.faces[at(j)];
        const double distance = triangle_distance(first, corners_at(places_, mesh_[at(other)]));
        if (distance < found.distance) found = {distance, face, other};
      }
    }
  }

  const std::vector<Vector3f>& places_;
  const std::vector<Triangle>& mesh_;
};

/// Pairs of shells whose boxes come within a distance, by a sweep along x.
std::vector<std::pair<std::int32_t, std::int32_t>> near_boxes(const std::vector<Box>& boxes, double distance) {
  std::vector<std::int32_t> order(boxes.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](std::int32_t a, std::int32_t b) {
    return std::make_pair(boxes[at(a)].low.x(), a) < std::make_pair(boxes[at(b)].low.x(), b);
  });
  std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const Box& box = boxes[at(order[i])];
    for (std::size_t j = i + 1; j < order.size(); ++j) {
      const Box& other = boxes[at(order[j])];
      if (other.low.x() > box.high.x() + distance) break;
      if (distance_of_boxes(box, other) <= distance) pairs.push_back(std::minmax(order[i], order[j]));
    }
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

double distance_of_segments(const Vector3d& p, const Vector3d& p_end, const Vector3d& q, const Vector3d& q_end) {
  const Vector3d u = p_end - p, v = q_end - q, w = p - q;
  const double uu = u.squaredNorm(), uv = u.dot(v), vv = v.squaredNorm(), uw = u.dot(w), vw = v.dot(w);
  const auto clamped = [](double t) { return std::clamp(t, 0.0, 1.0); };
  const double determinant = uu * vv - uv * uv;
  double s = determinant > 1e-14 * uu * vv ? clamped((uv * vw - vv * uw) / determinant) : 0.0;
  const double t = vv > 0.0 ? clamped((uv * s + vw) / vv) : 0.0;
  s = uu > 0.0 ? clamped((uv * t - uw) / uu) : 0.0;  // the best on the first segment for that place on the second
  return (w + s * u - t * v).norm();
}

/// True when a segment goes through a triangle that does not lie in one plane with it.
bool pierces(const Vector3d& from, const Vector3d& to, const TriangleCorners& c) {
  const Vector3d normal = (c[1] - c[0]).cross(c[2] - c[0]);
  const double above = normal.dot(from - c[0]), below = normal.dot(to - c[0]);
  if ((above > 0.0) == (below > 0.0) || above == below) return false;
  const Vector3d place = from + above / (above - below) * (to - from);
  for (std::size_t k = 0; k < 3; ++k) {
    if (normal.dot((c[(k + 1) % 3] - c[k]).cross(place - c[k])) < 0.0) return false;
  }
  return true;
}

}  // namespace

double triangle_distance(const TriangleCorners& first, const TriangleCorners& second) {
  double distance = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < 3; ++i) {
    const Vector3d &from = first[i], &to = first[(i + 1) % 3];
    if (pierces(from, to, second) || pierces(second[i], second[(i + 1) % 3], first)) return 0.0;
    distance = std::min({distance, geometry::nearest_on_triangle(from, second[0], second[1], second[2]).distance,
                         geometry::nearest_on_triangle(second[i], first[0], first[1], first[2]).distance});
    for (std::size_t j = 0; j < 3; ++j)
      distance = std::min(distance, distance_of_segments(from, to, second[j], second[(j + 1) % 3]));
  }
  return distance;
}

ShellGaps::ShellGaps(const std::vector<Vector3f>& vertices, const std::vector<Triangle>& faces, double touching,
                     std::size_t most_pairs)
    : rest_(vertices), faces_(faces), shells_(mesh_shells(vertices, faces)) {
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (!vertices[v].allFinite()) throw InputError("", "vertex " + std::to_string(v), "is not finite");
  }
  diagonal_ = bounding_box(vertices).diagonal();
  std::vector<std::vector<std::int32_t>> faces_of(shells_.count);
  std::vector<Vector3d> middles;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    faces_of[at(shells_.of_face[f])].push_back(static_cast<std::int32_t>(f));
    const TriangleCorners c = corners_at(vertices, faces[f]);
    middles.emplace_back((c[0] + c[1] + c[2]) / 3.0);
  }
  auto trees = std::make_shared<std::vector<ShellTree>>();
  std::vector<std::vector<Box>> boxes;
  std::vector<Box> whole;
  for (std::vector<std::int32_t>& of_shell : faces_of) {
    trees->push_back(grown_tree(std::move(of_shell), middles));
    boxes.push_back(fitted_boxes(trees->back(), vertices, faces));
    whole.push_back(boxes.back().front());
  }
  const double limit = touching * diagonal_;
  const PairSearch search(rest_, faces_);
  for (const auto& [first, second] : near_boxes(whole, limit)) {
    FacePair bound;
    bound.distance = std::nextafter(limit, std::numeric_limits<double>::infinity());
    const FacePair nearest =
        search.nearest((*trees)[at(first)], boxes[at(first)], (*trees)[at(second)], boxes[at(second)], bound, 0.0);
    if (nearest.first >= 0) pairs_.push_back({first, second, nearest.distance, nearest.first, nearest.second});
  }
  if (pairs_.size() > most_pairs) {
    std::stable_sort(pairs_.begin(), pairs_.end(),
                     [](const TouchingShells& a, const TouchingShells& b) { return a.distance < b.distance; });
    pairs_.resize(most_pairs);
  }
  trees_ = std::move(trees);
}

std::vector<double> ShellGaps::growth(const std::vector<Vector3f>& posed) const {
  if (posed.size() != rest_.size()) {
    throw InputError("", "posed",
                     std::to_string(posed.size()) + " places for " + std::to_string(rest_.size()) + " vertices");
  }
  std::vector<double> grown;
  const double rounding = kNoGrowth * diagonal_;
  const PairSearch search(posed, faces_);
  std::map<std::int32_t, std::vector<Box>> boxes;  // of shells that are searched
  const auto boxes_of = [&](std::int32_t shell) -> const std::vector<Box>& {
    std::vector<Box>& own = boxes[shell];
    if (own.empty()) own = fitted_boxes((*trees_)[at(shell)], posed, faces_);
    return own;
  };
  for (const TouchingShells& pair : pairs_) {
    // Most pairs still touch in the place of rest, and then nothing needs to be searched.
    FacePair nearest{triangle_distance(corners_at(posed, faces_[at(pair.face_first)]),
                                       corners_at(posed, faces_[at(pair.face_second)])),
                     pair.face_first, pair.face_second};
    const double enough = pair.distance + rounding;
    if (nearest.distance > enough) {
      nearest = search.nearest((*trees_)[at(pair.first)], boxes_of(pair.first), (*trees_)[at(pair.second)],
                               boxes_of(pair.second), nearest, enough);
    }
    grown.push_back(nearest.distance > enough ? (nearest.distance - pair.distance) / diagonal_ : 0.0);
  }
  return grown;
}

}  // namespace anigen::metrics
