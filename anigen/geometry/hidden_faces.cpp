#include "anigen/geometry/hidden_faces.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <string>

#include "anigen/asset/mesh_edges.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/percentile.h"
#include "anigen/geometry/min_cut.h"

namespace anigen::geometry {
namespace {

using Faces = std::vector<std::int32_t>;

class HiddenFaces {
 public:
  HiddenFaces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
              const std::vector<float>& visibility, const HiddenFaceRules& rules)
      : vertices_(vertices), edges_(faces, vertices.size()), visibility_(visibility), rules_(rules) {}

  FaceMarks run() const {
    FaceMarks hidden(visibility_.size(), 0);
    Faces inner;
    for (std::size_t f = 0; f < visibility_.size(); ++f) {
      if (visibility_[f] == 0.0f) inner.push_back(static_cast<std::int32_t>(f));
    }
    if (inner.empty()) return hidden;
    const FaceMarks candidates = source_side_of_min_cut(visibility_.size(), dual_edges(), inner, outer_faces());
    for (const Faces& part : face_components(edges_, visibility_.size(), candidates)) {
      if (median_visibility(part) > rules_.visible_part) continue;
      if (largest_new_hole(part) > rules_.largest_hole) continue;
      for (const std::int32_t face : part) hidden[at(face)] = 1;
    }
    return hidden;
  }

 private:
  Eigen::Vector3d position(std::int32_t vertex) const { return vertices_[at(vertex)].cast<double>(); }

  std::vector<float> visibility_of(const Faces& part) const {
    std::vector<float> values;
    values.reserve(part.size());
    for (const std::int32_t face : part) values.push_back(visibility_[at(face)]);
    return values;
  }

  double median_visibility(const Faces& part) const {
    std::vector<float> values = visibility_of(part);
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
  }

  Faces outer_faces() const {
    Faces outer;
    for (const Faces& component : face_components(edges_, visibility_.size())) {
      const double threshold =
          std::clamp(percentile(visibility_of(component), 75.0), rules_.least_outer, rules_.most_outer);
      std::copy_if(component.begin(), component.end(), std::back_inserter(outer),
                   [&](std::int32_t face) { return visibility_[at(face)] > threshold; });
    }
    return outer;
  }

  /// Faces on both sides of the mesh's edges; longer edges are dearer to cut.
  std::vector<CutEdge> dual_edges() const {
    std::vector<CutEdge> dual;
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      const MeshEdges::Faces faces = edges_.faces(e);
      if (faces.size() != 2) continue;
      dual.push_back({faces.first[0], faces.first[1], (position(edges_[e][0]) - position(edges_[e][1])).norm()});
    }
    return dual;
  }

  /// Edges on the border of the part that were not on the border of the mesh.
  std::vector<MeshEdges::Edge> new_border(const Faces& part) const {
    std::map<std::int32_t, std::size_t> sides;
    for (const std::int32_t face : part) {
      for (std::size_t side = 0; side < 3; ++side) {
        const std::int32_t edge = edges_.of_face(at(face), side);
        if (edge >= 0) ++sides[edge];
      }
    }
    std::vector<MeshEdges::Edge> border;
    for (const auto& [edge, count] : sides) {
      if (count == 1 && edges_.faces(at(edge)).size() > 1) border.push_back(edges_[at(edge)]);
    }
    return border;
  }

  double largest_new_hole(const Faces& part) const {
    double largest = 0.0;
    for (const std::vector<MeshEdges::Edge>& loop : connected_edges(new_border(part))) {
      largest = std::max(largest, fan_area(loop));
    }
    return largest;
  }

  static std::vector<std::vector<MeshEdges::Edge>> connected_edges(const std::vector<MeshEdges::Edge>& edges) {
    std::multimap<std::int32_t, std::size_t> at_vertex;
    for (std::size_t e = 0; e < edges.size(); ++e) {
      for (const std::int32_t vertex : edges[e]) at_vertex.emplace(vertex, e);
    }
    std::vector<char> taken(edges.size(), 0);
    std::vector<std::vector<MeshEdges::Edge>> groups;
    for (std::size_t start = 0; start < edges.size(); ++start) {
      if (taken[start] != 0) continue;
      taken[start] = 1;
      std::vector<MeshEdges::Edge> group{edges[start]};
      for (std::size_t next = 0; next < group.size(); ++next) {
        const MeshEdges::Edge edge = group[next];
        for (const std::int32_t vertex : edge) {
          const auto [first, last] = at_vertex.equal_range(vertex);
          for (auto other = first; other != last; ++other) {
            if (taken[other->second] != 0) continue;
            taken[other->second] = 1;
            group.push_back(edges[other->second]);
          }
        }
      }
      groups.push_back(std::move(group));
    }
    return groups;
  }

  /// Of the triangles between the edges and the mean of their middles.
  double fan_area(const std::vector<MeshEdges::Edge>& loop) const {
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    for (const auto& [a, b] : loop) center += 0.5 * (position(a) + position(b));
    center /= static_cast<double>(loop.size());
    double area = 0.0;
    for (const auto& [a, b] : loop) area += 0.5 * (position(a) - center).cross(position(b) - center).norm();
    return area;
  }

  const std::vector<Eigen::Vector3f>& vertices_;
  MeshEdges edges_;
  const std::vector<float>& visibility_;
  HiddenFaceRules rules_;
};

}  // namespace

FaceMarks hidden_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                       const std::vector<float>& visibility, const HiddenFaceRules& rules) {
  if (visibility.size() != faces.size()) {
    throw InputError("", "visibility",
                     std::to_string(visibility.size()) + " values for " + std::to_string(faces.size()) + " faces");
  }
  return HiddenFaces(vertices, faces, visibility, rules).run();
}

}  // namespace anigen::geometry
