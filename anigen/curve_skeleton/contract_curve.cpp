#include "anigen/curve_skeleton/contract_curve.h"

#include <string>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/curve_skeleton/closed_surface.h"

#ifdef ANIGEN_WITH_CGAL
#include "anigen/curve_skeleton/ordered_memory.h"
// CGAL collapses edges in the order of their addresses.
#define CGAL_ALLOCATOR(T) anigen::curve_skeleton::OrderedAllocator<T>
#define CGAL_EIGEN3_ENABLED 1
#include <CGAL/Mean_curvature_flow_skeletonization.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/boost/graph/Euler_operations.h>
#endif

namespace anigen::curve_skeleton {

#ifdef ANIGEN_WITH_CGAL

namespace {

using Point = CGAL::Simple_cartesian<double>::Point_3;
using SurfaceMesh = CGAL::Surface_mesh<Point>;
using Flow = CGAL::Mean_curvature_flow_skeletonization<SurfaceMesh>;

SurfaceMesh surface_mesh(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces) {
  using Vertex = SurfaceMesh::Vertex_index;
  SurfaceMesh mesh;
  for (const Eigen::Vector3d& v : vertices) mesh.add_vertex(Point(v.x(), v.y(), v.z()));
  const auto vertex = [](std::int32_t v) { return Vertex(static_cast<SurfaceMesh::size_type>(v)); };
  for (const Triangle& t : faces) mesh.add_face(vertex(t[0]), vertex(t[1]), vertex(t[2]));
  return mesh;
}

/// Far more than the flow was seen to take for each vertex.
constexpr std::size_t kBytesPerVertex = 65536;

}  // namespace

bool can_contract() { return true; }

CurveGraph contract_curve(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces,
                          const ContractionOptions& options) {
  require_closed_surface(vertices, faces);
  const OrderedMemory memory(vertices.size() * kBytesPerVertex);
  const SurfaceMesh mesh = surface_mesh(vertices, faces);
  Flow::Skeleton skeleton;
  try {
    Flow flow(mesh);
    flow.set_quality_speed_tradeoff(options.speed);
    flow.set_medially_centered_speed_tradeoff(options.centering);
    // CGAL's own loop cannot be interrupted.
    double original = 0.0, last = 0.0;
    for (std::size_t i = 0; i < options.most_iterations; ++i) {
      throw_if_interrupted();
      flow.contract();
      const double area = CGAL::Polygon_mesh_processing::area(flow.meso_skeleton());
      if (i == 0) original = area;
      if (i > 0 && std::abs(last - area) < flow.area_variation_factor() * original) break;
      last = area;
    }
    flow.convert_to_skeleton(skeleton);
  } catch (const Interrupted&) {
    throw;
  } catch (const std::exception& error) {
    throw Error(std::string("the surface could not be contracted to a curve: ") + error.what());
  }
  CurveGraph graph;
  graph.point_of_vertex.assign(vertices.size(), 0);
  for (const auto v : CGAL::make_range(boost::vertices(skeleton))) {
    const Point& p = skeleton[v].point;
    graph.points.emplace_back(p.x(), p.y(), p.z());
    if (!graph.points.back().allFinite()) throw Error("the curve that the surface was contracted to is not finite");
    for (const auto vertex : skeleton[v].vertices) {
      graph.point_of_vertex[static_cast<std::size_t>(vertex)] = static_cast<int>(v);
    }
  }
  for (const auto e : CGAL::make_range(boost::edges(skeleton))) {
    graph.edges.push_back({static_cast<int>(source(e, skeleton)), static_cast<int>(target(e, skeleton))});
  }
  return graph;
}

#else

bool can_contract() { return false; }

CurveGraph contract_curve(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces,
                          const ContractionOptions&) {
  require_closed_surface(vertices, faces);
  throw NotSupportedError("", "curve skeleton",
                          "mean curvature flow in a build without CGAL (CMake option ANIGEN_WITH_CGAL)");
}

#endif

}  // namespace anigen::curve_skeleton
