#include "anigen/eval/surface/matching_places.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <string>

#include "anigen/core/error.h"
#include "anigen/eval/surface/vertex_faces.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::eval {
namespace {

constexpr double kCoinciding = 1e-6, kProbe = 0.01;  // of the mesh's size
constexpr double kEqual = 1e-3;
constexpr std::size_t kMostFaces = 4096;  // at one place: more is not a mesh but an attack on the loops below

// A place by what it lies on: {-1, -1, vertex}, {-1, edge's vertices}, or {face, face, face}. Faces that share the
// vertex or the edge give the same place.
using Place = std::array<std::int32_t, 3>;

struct Candidate {
  Place place;
  geometry::SurfacePoint at;
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
  const Triangle& corners = mesh.faces[static_cast<std::size_t>(face)];
  const auto corner = [&](std::size_t i) {
    return Eigen::Vector3d(mesh.vertices[static_cast<std::size_t>(corners[i])].cast<double>());
  };
  FaceShape shape{corner(0), corner(1), corner(2), Eigen::Vector3d::Zero()};
  const Eigen::Vector3d cross = (shape.b - shape.a).cross(shape.c - shape.a);
  shape.area = 0.5 * cross.norm();
  if (shape.area > 0.0) shape.normal = cross / (2.0 * shape.area);
  return shape;
}

class Matcher {
 public:
  Matcher(const Mesh& from, const Mesh& to) : from_(from), to_(to), surface_(from), around_from_(from), around_to_(to) {
    const double size = bounding_box(from.vertices).longest_side();
    tolerance_ = kCoinciding * size;
    probe_ = kProbe * size;
  }

  std::vector<geometry::SurfacePoint> run() {
    std::vector<geometry::SurfacePoint> result;
    result.reserve(to_.vertices.size());
    std::int32_t guess = 0;
    for (std::size_t v = 0; v < to_.vertices.size(); ++v) {
      const Eigen::Vector3d vertex = to_.vertices[v].cast<double>();
      if (!vertex.allFinite())
        throw InputError("", "vertices[" + std::to_string(v) + "]", "the position is not finite");
      const geometry::NearestPoint nearest = surface_.query(vertex, guess);
      guess = nearest.at.face;
      const std::vector<Candidate> candidates = candidates_at(vertex, nearest.distance);
      result.push_back(candidates.size() < 2 ? nearest.at : chosen(v, candidates));
    }
    return result;
  }

 private:
  std::vector<Candidate> candidates_at(const Eigen::Vector3d& vertex, double distance) const {
    const std::vector<geometry::NearestPoint> near = surface_.within(vertex, distance + tolerance_);
    std::vector<Candidate> candidates;
    if (near.size() > kMostFaces) return candidates;
    for (const geometry::NearestPoint& point : near) {
      const Place place = place_of(point);
      const bool known = std::any_of(candidates.begin(), candidates.end(),
                                     [&](const Candidate& other) { return other.place == place; });
      if (!known) candidates.push_back({place, point.at});
    }
    return candidates;
  }

  Place place_of(const geometry::NearestPoint& point) const {
    const Triangle& corners = from_.faces[static_cast<std::size_t>(point.at.face)];
    for (const std::int32_t corner : corners) {
      const Eigen::Vector3d position = from_.vertices[static_cast<std::size_t>(corner)].cast<double>();
      if ((position - point.position).norm() <= 2.0 * tolerance_) return {-1, -1, corner};
    }
    const FaceShape face = shape_of(from_, point.at.face);
    for (int i = 0; i < 3; ++i) {
      const std::int32_t a = corners[static_cast<std::size_t>((i + 1) % 3)],
                         b = corners[static_cast<std::size_t>((i + 2) % 3)];
      const double length = (from_.vertices[static_cast<std::size_t>(a)] - from_.vertices[static_cast<std::size_t>(b)])
                                .cast<double>()
                                .norm();
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
    for (const std::int32_t face : around_from_[place[2]]) {
      const Triangle& corners = from_.faces[static_cast<std::size_t>(face)];
      const bool has_edge = place[1] < 0 || std::find(corners.begin(), corners.end(), place[1]) != corners.end();
      if (has_edge) faces.push_back(shape_of(from_, face));
    }
    return faces;
  }

  std::vector<FaceShape> surroundings(std::size_t vertex) const {
    std::vector<FaceShape> faces;
    for (const std::int32_t face : around_to_[static_cast<std::int32_t>(vertex)]) faces.push_back(shape_of(to_, face));
    return faces;
  }

  // How far one side's faces are from finding their like on the other side: 0 when each does.
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
        const double apart = geometry::nearest_on_triangle(probe, other.a, other.b, other.c).distance / reach;
        least = std::min(least, apart + 0.5 * (1.0 - face.normal.dot(other.normal)));
      }
      sum += face.area * least;
      total += face.area;
    }
    return total > 0.0 ? sum / total : 0.0;
  }

  geometry::SurfacePoint chosen(std::size_t v, const std::vector<Candidate>& candidates) {
    const Eigen::Vector3d vertex = to_.vertices[v].cast<double>();
    const std::vector<FaceShape> around = surroundings(v);
    std::vector<Rated> rated;
    for (const Candidate& candidate : candidates) {
      const std::vector<FaceShape> near = surroundings(candidate);
      const double there = missing(vertex, around, near);
      const double back = missing(geometry::position(candidate.at, from_.vertices, from_.faces), near, around);
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
  geometry::NearestSurface surface_;
  VertexFaces around_from_, around_to_;
  double tolerance_ = 0.0, probe_ = 0.0;
  std::map<std::vector<Place>, std::size_t> turns_;  // how often each choice between equal places came up
};

}  // namespace

std::vector<geometry::SurfacePoint> matching_places(const Mesh& from, const Mesh& to) {
  return Matcher(from, to).run();
}

}  // namespace anigen::eval
