#include "anigen/curve_skeleton/contraction.h"

#include <algorithm>
#include <string>
#include <tuple>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/process.h"

#ifdef ANIGEN_WITH_CGAL
// CGAL collapses edges in the order of their addresses.
#define CGAL_ALLOCATOR(T) anigen::curve_skeleton::OrderedAllocator<T>
#define CGAL_EIGEN3_ENABLED 1
#include <CGAL/Mean_curvature_flow_skeletonization.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/boost/graph/Euler_operations.h>
#endif

namespace anigen::curve_skeleton {

namespace {

[[noreturn]] void fail(const std::string& place, const std::string& problem) {
  throw InputError("", place, problem + "; only one closed surface can be contracted to a curve");
}

struct HalfEdge {
  std::int32_t from, to, face;
  bool operator<(const HalfEdge& other) const {
    return std::tie(from, to, face) < std::tie(other.from, other.to, other.face);
  }
};

#ifdef ANIGEN_WITH_CGAL

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

#endif

}  // namespace

void require_closed_surface(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces) {
  if (faces.size() < 4) fail("mesh.faces", "fewer than 4 faces enclose nothing");
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (!vertices[v].allFinite()) fail("mesh.vertices[" + std::to_string(v) + "]", "the vertex is not finite");
  }
  std::vector<HalfEdge> edges;
  std::vector<int> faces_at(vertices.size(), 0);
  std::vector<std::int32_t> first_face(vertices.size(), -1);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const std::string place = "mesh.faces[" + std::to_string(f) + "]";
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int32_t a = faces[f][k], b = faces[f][(k + 1) % 3];
      if (a < 0 || at(a) >= vertices.size()) fail(place, "there is no vertex " + std::to_string(a));
      if (a == b) fail(place, "it names a vertex twice");
      edges.push_back({a, b, static_cast<std::int32_t>(f)});
      ++faces_at[at(a)];
      first_face[at(a)] = static_cast<std::int32_t>(f);
    }
  }
  std::sort(edges.begin(), edges.end());
  /// The face that has the directed edge, -1 without one.
  const auto face_of = [&](std::int32_t from, std::int32_t to) {
    const auto found = std::lower_bound(edges.begin(), edges.end(), HalfEdge{from, to, -1});
    return found != edges.end() && found->from == from && found->to == to ? found->face : -1;
  };
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const bool repeated = e > 0 && edges[e].from == edges[e - 1].from && edges[e].to == edges[e - 1].to;
    if (repeated || face_of(edges[e].to, edges[e].from) < 0) {
      fail("edge " + std::to_string(edges[e].from) + "–" + std::to_string(edges[e].to),
           "it does not have two faces of opposite direction");
    }
  }
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const std::string place = "mesh.vertices[" + std::to_string(v) + "]";
    if (first_face[v] < 0) fail(place, "no face uses it");
    int turned = 0;
    std::int32_t face = first_face[v];
    do {
      const Triangle& t = faces[at(face)];
      const auto k = static_cast<std::size_t>(std::find(t.begin(), t.end(), static_cast<std::int32_t>(v)) - t.begin());
      face = face_of(static_cast<std::int32_t>(v), t[(k + 2) % 3]);
      ++turned;
    } while (face != first_face[v] && turned <= faces_at[v]);
    if (turned != faces_at[v]) fail(place, "its faces form several fans");
  }
  std::vector<char> seen(faces.size(), 0);
  std::vector<std::int32_t> open{0};
  std::size_t count = 1;
  seen[0] = 1;
  while (!open.empty()) {
    const Triangle t = faces[at(open.back())];
    open.pop_back();
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int32_t next = face_of(t[(k + 1) % 3], t[k]);
      if (seen[at(next)] != 0) continue;
      seen[at(next)] = 1;
      ++count;
      open.push_back(next);
    }
  }
  if (count != faces.size()) fail("mesh", "it has several pieces");
}

#ifdef ANIGEN_WITH_CGAL

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
    for (const auto vertex : skeleton[v].vertices)
      graph.point_of_vertex[static_cast<std::size_t>(vertex)] = static_cast<int>(v);
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
