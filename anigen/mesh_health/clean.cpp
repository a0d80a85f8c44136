#include "anigen/mesh_health/clean.h"

#include <CGAL/Polygon_mesh_processing/manifoldness.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/repair.h>
#include <CGAL/Polygon_mesh_processing/repair_degeneracies.h>
#include <CGAL/Polygon_mesh_processing/stitch_borders.h>

#include <algorithm>
#include <string>

#include "anigen/mesh_health/cgal_mesh.h"
#include "anigen/mesh_health/fans.h"
#include "anigen/mesh_health/parts.h"
#include "anigen/mesh_health/weld.h"

namespace anigen::mesh_health {

namespace {

namespace processing = CGAL::Polygon_mesh_processing;

using Polygon = std::array<std::size_t, 3>;

struct Soup {
  std::vector<Point> points;
  std::vector<Polygon> polygons;
};

/// Orients and parts the soup, then turns pieces over of which most faces were turned.
void orient_as_most_faces(Soup& soup, CleanSurface& result) {
  const std::vector<Polygon> before = soup.polygons;
  const std::size_t points_before = soup.points.size();
  processing::orient_polygon_soup(soup.points, soup.polygons);
  result.copied_vertices += soup.points.size() - points_before;
  // Copies of a point are other indices at equal coordinates, so corners are compared by place.
  std::vector<char> reversed(before.size(), 0);
  for (std::size_t f = 0; f < before.size(); ++f) {
    const auto corner = static_cast<std::size_t>(
        std::find_if(soup.polygons[f].begin(), soup.polygons[f].end(),
                     [&](std::size_t p) { return soup.points[p] == soup.points[before[f][0]]; }) -
        soup.polygons[f].begin());
    reversed[f] = soup.points[soup.polygons[f][(corner + 1) % 3]] != soup.points[before[f][1]];
  }
  std::vector<Triangle> faces(soup.polygons.size());
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (std::size_t k = 0; k < 3; ++k) faces[f][k] = static_cast<std::int32_t>(soup.polygons[f][k]);
  const std::vector<Eigen::Vector3f> anywhere(soup.points.size(), Eigen::Vector3f::Zero());
  const Parts parts = find_parts(anywhere, faces, MeshEdges(faces, soup.points.size()));
  std::vector<std::ptrdiff_t> balance(parts.size(), 0);  // turned faces less those left
  for (std::size_t f = 0; f < faces.size(); ++f) balance[parts.of_face[f]] += reversed[f] != 0 ? 1 : -1;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const bool turn_back = balance[parts.of_face[f]] > 0;
    if (turn_back) std::swap(soup.polygons[f][1], soup.polygons[f][2]);
    result.reversed_faces += (reversed[f] != 0) != turn_back;
  }
}

std::size_t count_degenerate(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  return static_cast<std::size_t>(
      std::count_if(faces.begin(), faces.end(), [&](const Triangle& face) { return is_degenerate(vertices, face); }));
}

}  // namespace

CleanSurface clean_surface(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  CleanSurface result;
  const PartedFaces parted = part_faces(vertices, faces);
  result.copied_vertices = parted.vertices.size() - vertices.size();
  Soup soup;
  soup.points.reserve(parted.vertices.size());
  for (const Eigen::Vector3f& v : parted.vertices) soup.points.emplace_back(v.x(), v.y(), v.z());
  soup.polygons.reserve(faces.size());
  for (const Triangle& t : parted.faces) soup.polygons.push_back({at(t[0]), at(t[1]), at(t[2])});
  try {
    orient_as_most_faces(soup, result);
    if (!processing::is_polygon_soup_a_polygon_mesh(soup.polygons))
      throw Error("the soup of triangles could not be made a manifold");
    SurfaceMesh surface;
    processing::polygon_soup_to_polygon_mesh(soup.points, soup.polygons, surface);
    processing::remove_isolated_vertices(surface);  // of points that no face has; the next asks for that
    processing::remove_degenerate_faces(surface);
    result.stitched_edges = processing::stitch_borders(surface, CGAL::parameters::apply_per_connected_component(true));
    result.stitched_edges += processing::stitch_borders(surface);
    result.copied_vertices += processing::duplicate_non_manifold_vertices(surface);
    result.mesh = to_mesh(surface);
    // Those with a vertex on the opposite side go by a flip, which leaves the number of faces as it is.
    result.degenerate_left = count_degenerate(result.mesh.vertices, result.mesh.faces);
    const std::size_t before = count_degenerate(vertices, faces);
    result.degenerate_faces = before - std::min(before, result.degenerate_left);
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw Error(std::string("the surface could not be repaired: ") + error.what());
  }
  return result;
}

}  // namespace anigen::mesh_health
