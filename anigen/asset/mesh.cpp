#include "anigen/asset/mesh.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen {

namespace {

/// Unit length; (0, 0, 1) where a sum is zero or not finite.
std::vector<Eigen::Vector3f> unit_normals(const std::vector<Eigen::Vector3d>& sums) {
  std::vector<Eigen::Vector3f> normals(sums.size(), Eigen::Vector3f::UnitZ());
  for (std::size_t v = 0; v < sums.size(); ++v) {
    const double length = sums[v].norm();
    if (length > 0.0 && std::isfinite(length)) normals[v] = (sums[v] / length).cast<float>();
  }
  return normals;
}

/// One side of a face, filed under the lower of its two vertices.
struct Side {
  std::int32_t higher, face;
  std::uint8_t corner;

  bool operator<(const Side& other) const {
    return std::tie(higher, face, corner) < std::tie(other.higher, other.face, other.corner);
  }
};

void check_indices(const std::vector<Triangle>& faces, std::size_t vertices) {
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (const std::int32_t vertex : faces[f]) {
      if (vertex >= 0 && at(vertex) < vertices) continue;
      throw InputError("", "faces[" + std::to_string(f) + "]", "there is no vertex " + std::to_string(vertex));
    }
  }
}

template <typename Body>
void each_side(const std::vector<Triangle>& faces, const Body& body) {
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (std::uint8_t k = 0; k < 3; ++k) {
      const std::int32_t a = faces[f][k], b = faces[f][(k + 1u) % 3u];
      if (a != b) body(std::min(a, b), Side{std::max(a, b), static_cast<std::int32_t>(f), k});
    }
  }
}

}  // namespace

Box bounding_box(const std::vector<Eigen::Vector3f>& points) {
  Box box;
  for (const Eigen::Vector3f& p : points) box.extend(p.cast<double>());
  return box;
}

std::vector<Eigen::Vector3d> in_double(const std::vector<Eigen::Vector3f>& points) {
  std::vector<Eigen::Vector3d> result;
  result.reserve(points.size());
  for (const Eigen::Vector3f& point : points) result.emplace_back(point.cast<double>());
  return result;
}

Eigen::Vector3d area_vector(const std::vector<Eigen::Vector3f>& vertices, const Triangle& face) {
  const Eigen::Vector3d a = vertices[at(face[0])].cast<double>();
  return (vertices[at(face[1])].cast<double>() - a).cross(vertices[at(face[2])].cast<double>() - a);
}

Eigen::Vector3d face_normal(const std::vector<Eigen::Vector3f>& vertices, const Triangle& face) {
  const Eigen::Vector3d normal = area_vector(vertices, face);
  const double length = normal.norm();
  return length > 0.0 ? Eigen::Vector3d(normal / length) : Eigen::Vector3d::Zero();
}

std::vector<Eigen::Vector3f> vertex_normals(const std::vector<Eigen::Vector3f>& vertices,
                                            const std::vector<Triangle>& faces) {
  std::vector<Eigen::Vector3d> sums(vertices.size(), Eigen::Vector3d::Zero());
  for (const Triangle& face : faces) {
    const Eigen::Vector3d normal = area_vector(vertices, face);  // large faces count more
    for (const int corner : face) sums[corner] += normal;
  }
  return unit_normals(sums);
}

MeshEdges::MeshEdges(const std::vector<Triangle>& faces, std::size_t vertices)
    : of_face_(faces.size(), Triangle{-1, -1, -1}), first_edge_(vertices + 1, 0) {
  check_indices(faces, vertices);
  std::vector<std::size_t> begin(vertices + 1, 0);
  each_side(faces, [&](std::int32_t lower, const Side&) { ++begin[at(lower) + 1]; });
  for (std::size_t v = 0; v < vertices; ++v) begin[v + 1] += begin[v];
  std::vector<Side> sides(begin.back());
  std::vector<std::size_t> next(begin.begin(), begin.end() - 1);
  each_side(faces, [&](std::int32_t lower, const Side& side) { sides[next[at(lower)]++] = side; });
  faces_.reserve(sides.size());
  for (std::size_t v = 0; v < vertices; ++v) {
    first_edge_[v] = edges_.size();
    const auto first = sides.begin() + static_cast<std::ptrdiff_t>(begin[v]);
    const auto last = sides.begin() + static_cast<std::ptrdiff_t>(begin[v + 1]);
    std::sort(first, last);
    for (auto side = first; side != last; ++side) {
      if (side == first || side->higher != std::prev(side)->higher) {
        if (side != first) offsets_.push_back(faces_.size());
        edges_.push_back({static_cast<std::int32_t>(v), side->higher});
      }
      of_face_[at(side->face)][side->corner] = static_cast<std::int32_t>(edges_.size()) - 1;
      faces_.push_back(side->face);
    }
    if (first != last) offsets_.push_back(faces_.size());
  }
  first_edge_[vertices] = edges_.size();
}

std::int32_t MeshEdges::find(std::int32_t a, std::int32_t b) const {
  const Edge edge{std::min(a, b), std::max(a, b)};
  const auto first = edges_.begin() + static_cast<std::ptrdiff_t>(first_edge_[at(edge[0])]);
  const auto last = edges_.begin() + static_cast<std::ptrdiff_t>(first_edge_[at(edge[0]) + 1]);
  const auto found = std::lower_bound(first, last, edge);
  return found != last && *found == edge ? static_cast<std::int32_t>(found - edges_.begin()) : -1;
}

std::vector<Eigen::Vector3f> angle_weighted_normals(const std::vector<Eigen::Vector3f>& vertices,
                                                    const std::vector<Triangle>& faces) {
  std::vector<Eigen::Vector3d> sums(vertices.size(), Eigen::Vector3d::Zero());
  for (const Triangle& face : faces) {
    std::array<Eigen::Vector3d, 3> sides;  // side k leads from corner k to the next
    for (std::size_t k = 0; k < 3; ++k)
      sides[k] = vertices[at(face[(k + 1) % 3])].cast<double>() - vertices[at(face[k])].cast<double>();
    const Eigen::Vector3d normal = sides[0].cross(sides[1]);
    const double twice_area = normal.norm();
    if (!(twice_area > 0.0)) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const double angle = std::atan2(twice_area, -sides[k].dot(sides[(k + 2) % 3]));
      sums[at(face[k])] += angle / twice_area * normal;
    }
  }
  return unit_normals(sums);
}

}  // namespace anigen
