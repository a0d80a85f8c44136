#pragma once
/// The mesh with half-edges that CGAL's algorithms work on. Only sources of this folder include it.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>

#include "anigen/asset/mesh.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::mesh_health {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;
using SurfaceMesh = CGAL::Surface_mesh<Point>;

/// @pre the faces are a manifold with borders @throws Error when they are not
inline SurfaceMesh to_surface_mesh(const Mesh& mesh) {
  SurfaceMesh result;
  for (const Eigen::Vector3f& v : mesh.vertices) result.add_vertex(Point(v.x(), v.y(), v.z()));
  const auto vertex = [](std::int32_t v) { return SurfaceMesh::Vertex_index(static_cast<SurfaceMesh::size_type>(v)); };
  for (const Triangle& t : mesh.faces) {
    if (result.add_face(vertex(t[0]), vertex(t[1]), vertex(t[2])) == SurfaceMesh::null_face())
      throw Error("the cleaned surface is not a manifold");
  }
  return result;
}

/// Vertices and faces, without removed ones and without vertices of no face.
inline Mesh to_mesh(const SurfaceMesh& surface) {
  Mesh mesh;
  std::vector<std::int32_t> number(surface.number_of_vertices() + surface.number_of_removed_vertices(), -1);
  for (const auto v : surface.vertices()) {
    if (surface.is_isolated(v)) continue;
    number[static_cast<std::size_t>(v)] = static_cast<std::int32_t>(mesh.vertices.size());
    const Point& p = surface.point(v);
    mesh.vertices.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()));
  }
  for (const auto f : surface.faces()) {
    Triangle face{};
    std::size_t k = 0;
    for (const auto v : surface.vertices_around_face(surface.halfedge(f))) {
      if (k == 3) throw Error("a face is no triangle");
      face[k++] = number[static_cast<std::size_t>(v)];
    }
    mesh.faces.push_back(face);
  }
  return mesh;
}

}  // namespace anigen::mesh_health
