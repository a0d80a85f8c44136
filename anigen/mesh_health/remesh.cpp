#include "anigen/mesh_health/remesh.h"

#include <CGAL/Polygon_mesh_processing/remesh.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "anigen/core/process.h"
#include "anigen/mesh_health/cgal_mesh.h"
#include "anigen/mesh_health/clean.h"
#include "anigen/mesh_health/parts.h"
#include "anigen/mesh_health/weld.h"

namespace anigen::mesh_health {

namespace {

/// Area of an equilateral triangle with sides of length 1.
constexpr double kUnitArea = 0.4330127018922193;
constexpr double kEnoughFaces = 0.05;  ///< share by which the number of faces may differ
constexpr std::size_t kMostAttempts = 6;
/// Borders and sharp edges that turn by more have a corner there.
constexpr double kCornerDegrees = 45.0;

Eigen::Vector3d vector_of(const Point& p) { return {p.x(), p.y(), p.z()}; }

struct Features {
  SurfaceMesh::Property_map<SurfaceMesh::Edge_index, bool> edges;
  SurfaceMesh::Property_map<SurfaceMesh::Vertex_index, bool> corners;
  std::size_t sharp = 0;
};

Features find_features(SurfaceMesh& surface, double sharp_degrees) {
  Features features;
  features.edges = surface.add_property_map<SurfaceMesh::Edge_index, bool>("e:feature", false).first;
  features.corners = surface.add_property_map<SurfaceMesh::Vertex_index, bool>("v:corner", false).first;
  const auto normal = [&](SurfaceMesh::Halfedge_index h) -> Eigen::Vector3d {
    const Eigen::Vector3d a = vector_of(surface.point(surface.source(h))),
                          b = vector_of(surface.point(surface.target(h)));
    return (b - a).cross(vector_of(surface.point(surface.target(surface.next(h)))) - a).normalized();
  };
  const double least_cosine = std::cos(sharp_degrees * kPi / 180.0);
  for (const auto e : surface.edges()) {
    const auto h = surface.halfedge(e, 0), o = surface.halfedge(e, 1);
    const bool border = surface.is_border(h) || surface.is_border(o);
    const bool sharp = !border && sharp_degrees < 180.0 && normal(h).dot(normal(o)) < least_cosine;
    features.edges[e] = border || sharp;
    features.sharp += sharp;
  }
  const double corner_cosine = std::cos(kCornerDegrees * kPi / 180.0);
  for (const auto v : surface.vertices()) {
    std::vector<Eigen::Vector3d> directions;
    for (const auto h : surface.halfedges_around_target(surface.halfedge(v))) {
      if (features.edges[surface.edge(h)])
        directions.push_back((vector_of(surface.point(surface.source(h))) - vector_of(surface.point(v))).normalized());
    }
    features.corners[v] = directions.size() == 1 || directions.size() > 2 ||
                          (directions.size() == 2 && -directions[0].dot(directions[1]) < corner_cosine);
  }
  return features;
}

double total_area(const Mesh& mesh) {
  double area = 0.0;
  for (const Triangle& face : mesh.faces) area += 0.5 * area_vector(mesh.vertices, face).norm();
  return area;
}

void require_few_faces(double area, double edge_length, std::size_t most) {
  const double expected = area / (kUnitArea * edge_length * edge_length);
  if (expected > static_cast<double>(most)) {
    throw InputError("", "edge length",
                     "would give about " + std::to_string(static_cast<std::uint64_t>(std::min(expected, 1e18))) +
                         " faces, and " + std::to_string(most) + " are the most");
  }
}

/// Edge lengths for a wanted number of faces. That number falls with the square of the length, but in steps: a regular
/// mesh collapses as a whole. So what follows lies between a length that gave too many and one that gave too few.
class LengthSearch {
 public:
  /// @param ratio of the faces that `length` gave to those wanted @return the length to try next
  double after(double length, double ratio) {
    (ratio > 1.0 ? too_short_ : too_long_) = Tried{length, std::log(ratio)};
    if (!too_short_ || !too_long_) return length * std::sqrt(ratio);
    const double share = too_short_->log_ratio / (too_short_->log_ratio - too_long_->log_ratio);
    return too_short_->length * std::pow(too_long_->length / too_short_->length, std::clamp(share, 0.25, 0.75));
  }

 private:
  struct Tried {
    double length, log_ratio;
  };
  std::optional<Tried> too_short_, too_long_;
};

Mesh pass(const Mesh& clean, double edge_length, const RemeshOptions& options, std::size_t& sharp) {
  SurfaceMesh surface = to_surface_mesh(clean);
  const Features features = find_features(surface, options.sharp_angle);
  sharp = features.sharp;
  try {
    CGAL::Polygon_mesh_processing::isotropic_remeshing(
        surface.faces(), edge_length, surface,
        CGAL::parameters::number_of_iterations(static_cast<unsigned>(options.iterations))
            .edge_is_constrained_map(features.edges)
            .vertex_is_constrained_map(features.corners));
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw Error(std::string("the mesh could not be remeshed: ") + error.what());
  }
  return to_mesh(surface);
}

}  // namespace

Remeshed remesh(const Mesh& mesh, const RemeshOptions& options, const StepReport& report) {
  if (options.edge_length < 0 || !std::isfinite(options.edge_length))
    throw InputError("", "edge length", "must be a finite number above 0");
  const WeldedMesh welded = weld(mesh);
  const Mesh clean = clean_surface(welded.places, welded.faces).mesh;
  const double area = total_area(clean);
  if (!(area > 0)) throw InputError("", "mesh.faces", "no face has an area");
  std::size_t wanted = options.faces;
  if (wanted == 0 && options.edge_length == 0) wanted = welded.faces.size();
  Remeshed result;
  result.edge_length =
      options.edge_length > 0 ? options.edge_length : std::sqrt(area / (kUnitArea * static_cast<double>(wanted)));
  require_few_faces(area, result.edge_length, options.most_faces);
  const std::size_t most_attempts = wanted > 0 ? kMostAttempts : 1;
  double best = 1e300;
  double length = result.edge_length;
  LengthSearch search;
  for (std::size_t attempt = 1; attempt <= most_attempts; ++attempt) {
    throw_if_interrupted();
    if (report) report(attempt - 1, most_attempts);
    Mesh made = pass(clean, length, options, result.sharp_edges);
    result.attempts = attempt;
    if (made.faces.empty()) throw Error("nothing is left of the mesh; a shorter edge length keeps more");
    const double ratio = wanted > 0 ? static_cast<double>(made.faces.size()) / static_cast<double>(wanted) : 1.0;
    if (std::abs(std::log(ratio)) < best) {
      best = std::abs(std::log(ratio));
      result.mesh = std::move(made);
      result.edge_length = length;
    }
    if (std::abs(ratio - 1.0) <= kEnoughFaces) break;
    length = search.after(length, ratio);
  }
  if (report) report(most_attempts, most_attempts);
  turn_outward(result.mesh);
  move_apart(result.mesh);
  return result;
}

Json to_json(const Remeshed& remeshed) {
  return {{"vertices", remeshed.mesh.vertices.size()},
          {"faces", remeshed.mesh.faces.size()},
          {"edge_length", remeshed.edge_length},
          {"sharp_edges", remeshed.sharp_edges},
          {"attempts", remeshed.attempts}};
}

}  // namespace anigen::mesh_health
