#include "anigen/geometry/fill_holes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdint>
#include <set>
#include <utility>

#include "anigen/asset/mesh_edges.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/boundary_loops.h"
#include "anigen/geometry/face_sets.h"
#include "anigen/geometry/hole_refinement.h"
#include "anigen/geometry/hole_triangulation.h"

namespace anigen::geometry {
namespace {

using Loop = std::vector<std::int32_t>;

class HoleFiller {
 public:
  HoleFiller(const std::vector<Eigen::Vector3f>& vertices, std::vector<Triangle> faces)
      : edges_(faces, vertices.size()) {
    mesh_.vertices = vertices;
    mesh_.faces = std::move(faces);
    scale_sums_.assign(vertices.size(), 0.0);
    scale_counts_.assign(vertices.size(), 0);
    for (const MeshEdges::Edge& edge : edges_.all()) {
      const double length = (position(edge[0]) - position(edge[1])).norm();
      for (const std::int32_t vertex : edge) {
        scale_sums_[at(vertex)] += length;
        ++scale_counts_[at(vertex)];
      }
    }
  }

  FilledMesh run(const HoleFilling& options) {
    FilledMesh result;
    BoundaryLoops borders = boundary_loops(mesh_.faces, edges_);
    result.broken = borders.broken;
    for (Loop& loop : borders.loops) {
      const bool closed = loop.size() <= options.most_edges && fill(loop, options.refine);
      ++(closed ? result.filled : result.left_open);
    }
    result.mesh = std::move(mesh_);
    return result;
  }

 private:
  Eigen::Vector3d position(std::int32_t vertex) const { return mesh_.vertices[at(vertex)].cast<double>(); }

  Eigen::Vector3d unit_normal(const Triangle& face) const {
    const Eigen::Vector3d a = position(face[0]);
    const Eigen::Vector3d cross = (position(face[1]) - a).cross(position(face[2]) - a);
    const double length = cross.norm();
    return length > 0.0 ? Eigen::Vector3d(cross / length) : Eigen::Vector3d::Zero();
  }

  const Triangle& face_at(std::int32_t a, std::int32_t b) const {
    return mesh_.faces[at(*edges_.faces(at(edges_.find(a, b))).first)];
  }

  bool is_free(std::int32_t a, std::int32_t b) const {
    return edges_.find(a, b) < 0 && made_.count({std::min(a, b), std::max(a, b)}) == 0;
  }

  bool fill(Loop loop, bool refine) {
    // New faces run against the sides of the old ones.
    std::reverse(loop.begin(), loop.end());
    if (loop.size() == 3 && is_on_its_face(loop)) return false;
    HoleOutline outline;
    for (std::size_t i = 0; i < loop.size(); ++i) {
      outline.points.push_back(position(loop[i]));
      outline.outside.push_back(unit_normal(face_at(loop[i], loop[(i + 1) % loop.size()])));
    }
    outline.may_connect = [&](std::int32_t a, std::int32_t b) { return is_free(loop[at(a)], loop[at(b)]); };
    std::vector<double> scale;
    for (const std::int32_t vertex : loop) {
      scale.push_back(scale_sums_[at(vertex)] / static_cast<double>(scale_counts_[at(vertex)]));
    }
    HolePatch patch{outline.points, triangulate_hole(outline), static_cast<std::int32_t>(loop.size())};
    if (patch.faces.empty()) add_fan(patch, scale);
    if (refine) refine_patch(patch, scale, outline.may_connect);
    append(patch, loop);
    return true;
  }

  /// The loop around a triangle that stands alone: its patch would be the same triangle from behind.
  bool is_on_its_face(const Loop& loop) const {
    const Triangle& face = face_at(loop[0], loop[1]);
    return std::find(face.begin(), face.end(), loop[2]) != face.end();
  }

  static void add_fan(HolePatch& patch, std::vector<double>& scale) {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    double mean_scale = 0.0;
    const std::int32_t count = patch.outline;
    for (std::int32_t i = 0; i < count; ++i) {
      middle += patch.points[at(i)] / count;
      mean_scale += scale[at(i)] / count;
      patch.faces.push_back({i, (i + 1) % count, count});
    }
    patch.points.push_back(middle);
    scale.push_back(mean_scale);
  }

  void append(const HolePatch& patch, const Loop& loop) {
    const auto first_new = static_cast<std::int32_t>(mesh_.vertices.size());
    for (std::size_t i = loop.size(); i < patch.points.size(); ++i) {
      mesh_.vertices.push_back(patch.points[i].cast<float>());
    }
    for (Triangle face : patch.faces) {
      for (std::int32_t& corner : face)
        corner = corner < patch.outline ? loop[at(corner)] : first_new + corner - patch.outline;
      mesh_.faces.push_back(face);
      for (std::size_t k = 0; k < 3; ++k) made_.insert(std::minmax(face[k], face[(k + 1) % 3]));
    }
  }

  MeshEdges edges_;  ///< of the mesh as it came
  Mesh mesh_;
  std::vector<double> scale_sums_;
  std::vector<std::size_t> scale_counts_;
  std::set<std::pair<std::int32_t, std::int32_t>> made_;  ///< edges of patches
};

}  // namespace

FilledMesh fill_holes(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                      const HoleFilling& options) {
  return HoleFiller(vertices, proper_faces(faces)).run(options);
}

}  // namespace anigen::geometry
