#include "anigen/prepare/augment/pose_checks.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/geometry/ray_caster.h"
#include "anigen/geometry/surface_sampling.h"

namespace anigen::prepare {
namespace {

constexpr std::size_t kPlaces = 400;
constexpr int kDirections = 32;
constexpr double kShrunk = 0.05, kStretched = 4.0, kFarthest = 1000.0, kSmallest = 1e-4;

using Vertices = std::vector<Eigen::Vector3f>;

Eigen::Vector3d corner(const Vertices& vertices, const Triangle& face, std::size_t i) {
  return vertices[static_cast<std::size_t>(face[i])].cast<double>();
}

double area(const Vertices& vertices, const Triangle& face) {
  const Eigen::Vector3d a = corner(vertices, face, 0);
  return 0.5 * (corner(vertices, face, 1) - a).cross(corner(vertices, face, 2) - a).norm();
}

double length(const Vertices& vertices, const Triangle& face, std::size_t edge) {
  return (corner(vertices, face, (edge + 1) % 3) - corner(vertices, face, edge)).norm();
}

// Middle over longest side of the bounding box.
double thickness(const Box& box) {
  Eigen::Vector3d sides = box.high - box.low;
  std::sort(sides.data(), sides.data() + 3);
  return sides[2] > 0.0 ? sides[1] / sides[2] : 0.0;
}

// The value below which half of the weight lies.
double weighted_median(std::vector<std::pair<double, double>> values_and_weights) {
  std::sort(values_and_weights.begin(), values_and_weights.end());
  double total = 0.0, below = 0.0;
  for (const auto& [value, weight] : values_and_weights) total += weight;
  for (const auto& [value, weight] : values_and_weights) {
    below += weight;
    if (below >= 0.5 * total) return value;
  }
  return 1.0;
}

// Signed volume, seen from the middle of the vertices, which keeps the terms small.
double volume(const Vertices& vertices, const std::vector<Triangle>& faces) {
  const Eigen::Vector3d middle = bounding_box(vertices).center();
  double sum = 0.0;
  for (const Triangle& face : faces) {
    const Eigen::Vector3d a = corner(vertices, face, 0) - middle, b = corner(vertices, face, 1) - middle;
    sum += a.dot(b.cross(corner(vertices, face, 2) - middle)) / 6.0;
  }
  return sum;
}

// Every edge is walked as often one way as the other, with vertices at one position taken as one: only then does the
// sum above not depend on where it is taken from.
bool closed(const Vertices& vertices, const std::vector<Triangle>& faces) {
  std::map<std::tuple<float, float, float>, int> ids;
  std::vector<int> id(vertices.size());
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const Eigen::Vector3f& p = vertices[v];
    id[v] = ids.emplace(std::make_tuple(p.x(), p.y(), p.z()), static_cast<int>(ids.size())).first->second;
  }
  std::map<std::pair<int, int>, int> balance;
  for (const Triangle& face : faces) {
    for (std::size_t i = 0; i < 3; ++i) {
      const int a = id[static_cast<std::size_t>(face[i])], b = id[static_cast<std::size_t>(face[(i + 1) % 3])];
      if (a != b) balance[std::minmax(a, b)] += a < b ? 1 : -1;
    }
  }
  return std::all_of(balance.begin(), balance.end(), [](const auto& edge) { return edge.second == 0; });
}

// Evenly over the sphere, along a spiral of golden angles.
std::array<Eigen::Vector3d, kDirections> directions() {
  std::array<Eigen::Vector3d, kDirections> result;
  for (int i = 0; i < kDirections; ++i) {
    const double z = 1.0 - (2.0 * i + 1.0) / kDirections, turn = 2.399963229728653 * i, r = std::sqrt(1.0 - z * z);
    result[static_cast<std::size_t>(i)] = {r * std::cos(turn), r * std::sin(turn), z};
  }
  return result;
}

}  // namespace

struct PoseChecks::Implementation {
  Vertices vertices;
  std::vector<Triangle> faces;
  Box box;
  std::vector<double> areas;
  double total_area = 0.0;
  std::optional<double> volume;
  std::vector<geometry::SurfacePoint> places;
  std::vector<bool> hidden;  // before

  std::vector<bool> hidden_places(const Vertices& posed, double size) const {
    static const std::array<Eigen::Vector3d, kDirections> rays = directions();
    const geometry::RayCaster caster(posed, faces);
    std::vector<bool> result;
    for (const geometry::SurfacePoint& place : places) {
      const Eigen::Vector3d from = geometry::position(place, posed, faces);
      result.push_back(std::all_of(rays.begin(), rays.end(), [&](const Eigen::Vector3d& direction) {
        return caster.first_hit(from, direction, 1e-4 * size).has_value();
      }));
    }
    return result;
  }
};

PoseChecks::PoseChecks(const Mesh& source) : implementation_(std::make_unique<Implementation>()) {
  Implementation& self = *implementation_;
  self.vertices = source.vertices;
  self.faces = source.faces;
  Rng rng(0, "places of pose checks");
  self.places = geometry::sample_surface(self.vertices, self.faces, kPlaces, rng);
  self.box = bounding_box(self.vertices);
  self.hidden = self.hidden_places(self.vertices, self.box.longest_side());  // refuses bad vertices
  for (const Triangle& face : self.faces) {
    self.areas.push_back(area(self.vertices, face));
    self.total_area += self.areas.back();
  }
  if (closed(self.vertices, self.faces)) {
    const double enclosed = prepare::volume(self.vertices, self.faces);
    // A sheet with two sides is closed, but encloses nothing that could be compared.
    if (std::abs(enclosed) > 1e-3 * std::pow(self.total_area, 1.5)) self.volume = enclosed;
  }
}

PoseChecks::~PoseChecks() = default;
PoseChecks::PoseChecks(PoseChecks&&) noexcept = default;
PoseChecks& PoseChecks::operator=(PoseChecks&&) noexcept = default;

PoseMeasures PoseChecks::measure(const Vertices& vertices) const {
  const Implementation& self = *implementation_;
  if (vertices.size() != self.vertices.size()) throw InputError("", "vertices", "a pose must move every vertex");
  PoseMeasures result;
  const double size = self.box.longest_side();
  for (const Eigen::Vector3f& vertex : vertices) {
    result.finite &= vertex.allFinite() && vertex.cast<double>().cwiseAbs().maxCoeff() <=
                                               kFarthest * size + self.box.center().cwiseAbs().maxCoeff();
  }
  if (!result.finite) return result;

  std::vector<double> areas;
  std::vector<std::pair<double, double>> changes;
  double after = 0.0;
  for (std::size_t f = 0; f < self.faces.size(); ++f) {
    areas.push_back(area(vertices, self.faces[f]));
    after += areas[f];
    if (self.areas[f] > 0.0) changes.emplace_back(areas[f] / self.areas[f], self.areas[f]);
  }
  result.scale = std::sqrt(weighted_median(std::move(changes)));
  if (!(result.scale > kSmallest)) return result;
  const double scale = result.scale;

  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  const auto way = [&](std::size_t v) {
    return Eigen::Vector3d(vertices[v].cast<double>() / scale - self.vertices[v].cast<double>());
  };
  for (std::size_t v = 0; v < vertices.size(); ++v) mean += way(v);
  mean /= static_cast<double>(vertices.size());
  double squares = 0.0;
  for (std::size_t v = 0; v < vertices.size(); ++v) squares += (way(v) - mean).squaredNorm();
  result.change = std::sqrt(squares / static_cast<double>(vertices.size())) / size;

  const Box box = bounding_box(vertices);
  result.box_ratio = box.longest_side() / (scale * size);
  const double thickness_before = thickness(self.box);
  result.thickness_ratio = thickness_before > 1e-6 ? thickness(box) / thickness_before : 1.0;

  double shrunk = 0.0, stretched = 0.0;
  for (std::size_t f = 0; f < self.faces.size(); ++f) {
    const Triangle& face = self.faces[f];
    if (areas[f] < kShrunk * scale * scale * self.areas[f]) shrunk += self.areas[f];
    for (std::size_t e = 0; e < 3; ++e) {
      if (!(length(vertices, face, e) > kStretched * scale * length(self.vertices, face, e))) continue;
      stretched += areas[f];
      break;
    }
  }
  if (self.total_area > 0.0) {
    result.area_ratio = after / (scale * scale * self.total_area);
    result.shrunk_share = shrunk / self.total_area;
  }
  if (after > 0.0) result.stretched_share = stretched / after;
  if (self.volume) result.volume_ratio = prepare::volume(vertices, self.faces) / (scale * scale * scale * *self.volume);

  const std::vector<bool> hidden = self.hidden_places(vertices, box.longest_side());
  std::size_t buried = 0;
  for (std::size_t i = 0; i < hidden.size(); ++i) buried += hidden[i] && !self.hidden[i] ? 1 : 0;
  result.buried_share = static_cast<double>(buried) / static_cast<double>(hidden.size());
  return result;
}

}  // namespace anigen::prepare
