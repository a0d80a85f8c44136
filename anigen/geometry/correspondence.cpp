#include "anigen/geometry/correspondence.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/nearest_point.h"

namespace anigen::geometry {

namespace {

/// The faces around each vertex of a mesh, by index, ascending; a face that names a vertex twice is listed once.
/// @throws InputError when a face refers to a vertex that is missing
std::vector<std::vector<std::int32_t>> vertex_faces(const Mesh& mesh) {
  std::vector<std::vector<std::int32_t>> around(mesh.vertices.size());
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    const auto face = static_cast<std::int32_t>(f);
    for (const std::int32_t vertex : mesh.faces[f]) {
      if (vertex < 0 || at(vertex) >= around.size())
        throw InputError("", "faces[" + std::to_string(f) + "]", "there is no vertex " + std::to_string(vertex));
      std::vector<std::int32_t>& faces = around[at(vertex)];
      if (faces.empty() || faces.back() != face) faces.push_back(face);
    }
  }
  return around;
}

constexpr double kCoinciding = 1e-6, kProbe = 0.01;  // of the mesh's size
constexpr double kEqual = 1e-3;
constexpr std::size_t kMostFaces = 4096;  // at one place: more is not a mesh but an attack on the loops below

// A place by what it lies on: {-1, -1, vertex}, {-1, edge's vertices}, or {face, face, face}. Faces that share the
// vertex or the edge give the same place.
using Place = std::array<std::int32_t, 3>;

struct Candidate {
  Place place;
  SurfacePoint at;
};

// The lesser and the greater of the two ways to compare surroundings.
struct Rated {
  const Candidate* candidate;
  double lesser, greater;
};

void keep_least(std::vector<Rated>& rated, double Rated::*rating) {
  double least = std::numeric_limits<double>::infinity();
  for (const Rated& each : rated) least = std::min(least, each.*rating);
  rated.erase(
      std::remove_if(rated.begin(), rated.end(), [&](const Rated& each) { return each.*rating > least + kEqual; }),
      rated.end());
}

struct FaceShape {
  Eigen::Vector3d a, b, c, normal;  // normal is 0 without area
  double area = 0.0;
};

FaceShape shape_of(const Mesh& mesh, std::int32_t face) {
  const Triangle& corners = mesh.faces[at(face)];
  const auto corner = [&](std::size_t i) { return Eigen::Vector3d(mesh.vertices[at(corners[i])].cast<double>()); };
  FaceShape shape{corner(0), corner(1), corner(2), Eigen::Vector3d::Zero()};
  const Eigen::Vector3d cross = (shape.b - shape.a).cross(shape.c - shape.a);
  shape.area = 0.5 * cross.norm();
  if (shape.area > 0.0) shape.normal = cross / (2.0 * shape.area);
  return shape;
}

class Matcher {
 public:
  Matcher(const Mesh& from, const Mesh& to)
      : from_(from), to_(to), surface_(from), around_from_(vertex_faces(from)), around_to_(vertex_faces(to)) {
    const double size = bounding_box(from.vertices).longest_side();
    tolerance_ = kCoinciding * size;
    probe_ = kProbe * size;
  }

  std::vector<SurfacePoint> run() {
    std::vector<SurfacePoint> result;
    result.reserve(to_.vertices.size());
    std::int32_t guess = 0;
    for (std::size_t v = 0; v < to_.vertices.size(); ++v) {
      const Eigen::Vector3d vertex = to_.vertices[v].cast<double>();
      if (!vertex.allFinite())
        throw InputError("", "vertices[" + std::to_string(v) + "]", "the position is not finite");
      const NearestPoint nearest = surface_.query(vertex, guess);
      guess = nearest.at.face;
      const std::vector<Candidate> candidates = candidates_at(vertex, nearest.distance);
      result.push_back(candidates.size() < 2 ? nearest.at : chosen(v, candidates));
    }
    return result;
  }

 private:
  std::vector<Candidate> candidates_at(const Eigen::Vector3d& vertex, double distance) const {
    const std::vector<NearestPoint> near = surface_.within(vertex, distance + tolerance_);
    std::vector<Candidate> candidates;
    if (near.size() > kMostFaces) return candidates;
    for (const NearestPoint& point : near) {
      const Place place = place_of(point);
      const bool known = std::any_of(candidates.begin(), candidates.end(),
                                     [&](const Candidate& other) { return other.place == place; });
      if (!known) candidates.push_back({place, point.at});
    }
    return candidates;
  }

  Place place_of(const NearestPoint& point) const {
    const Triangle& corners = from_.faces[at(point.at.face)];
    for (const std::int32_t corner : corners) {
      const Eigen::Vector3d position = from_.vertices[at(corner)].cast<double>();
      if ((position - point.position).norm() <= 2.0 * tolerance_) return {-1, -1, corner};
    }
    const FaceShape face = shape_of(from_, point.at.face);
    for (int i = 0; i < 3; ++i) {
      const std::int32_t a = corners[at((i + 1) % 3)], b = corners[at((i + 2) % 3)];
      const double length = (from_.vertices[at(a)] - from_.vertices[at(b)]).cast<double>().norm();
      // Barycentric weight times height is the distance from the edge.
      if (point.at.barycentric[i] * 2.0 * face.area <= 2.0 * tolerance_ * length)
        return {-1, std::min(a, b), std::max(a, b)};
    }
    return {point.at.face, point.at.face, point.at.face};
  }

  std::vector<FaceShape> surroundings(const Candidate& candidate) const {
    const Place& place = candidate.place;
    if (place[0] >= 0) return {shape_of(from_, place[0])};
    std::vector<FaceShape> faces;
    for (const std::int32_t face : around_from_[at(place[2])]) {
      const Triangle& corners = from_.faces[at(face)];
      const bool has_edge = place[1] < 0 || std::find(corners.begin(), corners.end(), place[1]) != corners.end();
      if (has_edge) faces.push_back(shape_of(from_, face));
    }
    return faces;
  }

  std::vector<FaceShape> surroundings(std::size_t vertex) const {
    std::vector<FaceShape> faces;
    for (const std::int32_t face : around_to_[vertex]) faces.push_back(shape_of(to_, face));
    return faces;
  }

  // Distance of one side's faces from finding their like on the other side: 0 when each does.
  double missing(const Eigen::Vector3d& center, const std::vector<FaceShape>& faces,
                 const std::vector<FaceShape>& others) const {
    double sum = 0.0, total = 0.0;
    for (const FaceShape& face : faces) {
      const Eigen::Vector3d middle = (face.a + face.b + face.c) / 3.0 - center;
      const double reach = std::min(0.25 * middle.norm(), probe_);
      if (!(face.area > 0.0) || !(reach > 0.0)) continue;
      const Eigen::Vector3d probe = center + reach * middle.normalized();
      double least = 2.0;  // nothing there, or facing the other way at the next best place
      for (const FaceShape& other : others) {
        const double apart = nearest_on_triangle(probe, other.a, other.b, other.c).distance / reach;
        least = std::min(least, apart + 0.5 * (1.0 - face.normal.dot(other.normal)));
      }
      sum += face.area * least;
      total += face.area;
    }
    return total > 0.0 ? sum / total : 0.0;
  }

  SurfacePoint chosen(std::size_t v, const std::vector<Candidate>& candidates) {
    const Eigen::Vector3d vertex = to_.vertices[v].cast<double>();
    const std::vector<FaceShape> around = surroundings(v);
    std::vector<Rated> rated;
    for (const Candidate& candidate : candidates) {
      const std::vector<FaceShape> near = surroundings(candidate);
      const double there = missing(vertex, around, near);
      const double back = missing(position(candidate.at, from_.vertices, from_.faces), near, around);
      rated.push_back({&candidate, std::min(there, back), std::max(there, back)});
    }
    keep_least(rated, &Rated::lesser);
    keep_least(rated, &Rated::greater);
    if (rated.size() == 1) return rated.front().candidate->at;
    std::sort(rated.begin(), rated.end(),
              [](const Rated& a, const Rated& b) { return a.candidate->place < b.candidate->place; });
    std::vector<Place> choice;
    for (const Rated& each : rated) choice.push_back(each.candidate->place);
    return rated[turns_[choice]++ % rated.size()].candidate->at;
  }

  const Mesh& from_;
  const Mesh& to_;
  NearestSurface surface_;
  std::vector<std::vector<std::int32_t>> around_from_, around_to_;
  double tolerance_ = 0.0, probe_ = 0.0;
  std::map<std::vector<Place>, std::size_t> turns_;  // how often each choice between equal places came up
};

void check_rows(std::size_t rows, std::size_t vertices) {
  if (rows == vertices) return;
  throw InputError("", "skin", std::to_string(rows) + " rows of weights for " + std::to_string(vertices) + " vertices");
}

void check_point(const Eigen::Vector3d& point, std::size_t index) {
  if (!point.allFinite()) throw InputError("", "points[" + std::to_string(index) + "]", "the position is not finite");
}

void check_length(std::size_t length, std::size_t vertices, const char* what) {
  if (length == 0 || length == vertices) return;
  throw InputError("", what, std::to_string(length) + " entries for " + std::to_string(vertices) + " vertices");
}

}  // namespace

std::vector<SurfacePoint> matching_places(const Mesh& from, const Mesh& to) { return Matcher(from, to).run(); }

SkinWeights transfer_skin(const NearestSurface& surface, const std::vector<Triangle>& faces, const SkinWeights& skin,
                          const std::vector<Eigen::Vector3d>& points) {
  std::vector<SurfacePoint> places;
  places.reserve(points.size());
  std::int32_t guess = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    check_point(points[i], i);
    places.push_back(surface.query(points[i], guess).at);
    guess = places.back().face;
  }
  return interpolate_skin(skin, faces, places);
}

SkinWeights transfer_skin(const Mesh& mesh, const SkinWeights& skin, const std::vector<Eigen::Vector3d>& points) {
  check_rows(skin.rows(), mesh.vertices.size());
  return transfer_skin(NearestSurface(mesh), mesh.faces, skin, points);
}

SkinWeights transfer_skin_to_mesh(const Mesh& mesh, const SkinWeights& skin, const Mesh& to) {
  check_rows(skin.rows(), mesh.vertices.size());
  return interpolate_skin(skin, mesh.faces, matching_places(mesh, to));
}

SkinWeights transfer_skin_by_vertex(const std::vector<Eigen::Vector3d>& vertices, const SkinWeights& skin,
                                    const std::vector<Eigen::Vector3d>& points) {
  check_rows(skin.rows(), vertices.size());
  const PointIndex index(vertices);
  SkinWeights result;
  result.offsets.reserve(points.size() + 1);
  for (std::size_t i = 0; i < points.size(); ++i) {
    check_point(points[i], i);
    result.append_copy(skin, index.nearest(points[i]).index);
  }
  return result;
}

TransferredAttributes transfer_attributes(const Mesh& from, const SkinWeights& skin,
                                          const std::vector<Eigen::Vector3f>& points) {
  check_length(skin.rows(), from.vertices.size(), "skin");
  check_length(from.colors.size(), from.vertices.size(), "colors");
  std::vector<SurfacePoint> places;
  places.reserve(points.size());
  for (const NearestPoint& nearest : NearestSurface(from).query(points)) places.push_back(nearest.at);
  TransferredAttributes result;
  if (skin.rows() > 0) result.skin = interpolate_skin(skin, from.faces, places);
  if (from.colors.empty()) return result;
  for (const SurfacePoint& place : places) {
    const Triangle& face = from.faces[at(place.face)];
    Eigen::Vector4d color = Eigen::Vector4d::Zero();
    for (int k = 0; k < 3; ++k) color += place.barycentric[k] * from.colors[at(face[at(k)])].cast<double>();
    result.colors.push_back(color.cast<float>());
  }
  return result;
}

}  // namespace anigen::geometry
