#include "anigen/rig/binding/surface_parts.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numeric>

#include "anigen/core/numeric.h"

namespace anigen::rig {
namespace {

/// Union–find whose representatives are the lowest members.
class Joined {
 public:
  explicit Joined(std::size_t count) : above_(count) { std::iota(above_.begin(), above_.end(), 0); }
  std::int32_t find(std::int32_t i) {
    while (above_[at(i)] != i) i = above_[at(i)] = above_[at(above_[at(i)])];
    return i;
  }
  void join(std::int32_t a, std::int32_t b) {
    const std::int32_t first = find(a), second = find(b);
    above_[at(std::max(first, second))] = std::min(first, second);
  }

 private:
  std::vector<std::int32_t> above_;
};

Eigen::Vector3d area_vector(const WeldedSurface& surface, const Triangle& face) {
  const Eigen::Vector3d& a = surface.places[at(face[0])];
  return 0.5 * (surface.places[at(face[1])] - a).cross(surface.places[at(face[2])] - a);
}

}  // namespace

bool SurfaceParts::encloses_space(std::size_t part) const {
  constexpr double kSphere = 1.0 / (6.0 * 1.7724538509055160);  // V / A^1.5 = 1 / (6 √π)
  constexpr double kLeast = 0.02;                               // flatter things are sheets
  return std::abs(volumes[part]) > kLeast * kSphere * std::pow(areas[part], 1.5);
}

SurfaceParts surface_parts(const WeldedSurface& surface) {
  Joined joined(surface.places.size());
  for (const Triangle& face : surface.faces) {
    joined.join(face[0], face[1]);
    joined.join(face[0], face[2]);
  }
  SurfaceParts parts;
  parts.of_place.resize(surface.places.size());
  std::vector<std::int32_t> first;
  for (std::size_t p = 0; p < surface.places.size(); ++p) {
    const std::int32_t lowest = joined.find(static_cast<std::int32_t>(p));
    if (at(lowest) == p) {
      parts.of_place[p] = static_cast<std::int32_t>(first.size());
      first.push_back(lowest);
    } else {
      parts.of_place[p] = parts.of_place[at(lowest)];
    }
  }
  parts.volumes.assign(first.size(), 0.0);
  parts.areas.assign(first.size(), 0.0);
  for (const Triangle& face : surface.faces) {
    const std::size_t part = at(parts.of_place[at(face[0])]);
    const Eigen::Vector3d vector = area_vector(surface, face);
    parts.volumes[part] += (surface.places[at(face[0])] - surface.places[at(first[part])]).dot(vector) / 3.0;
    parts.areas[part] += vector.norm();
  }
  return parts;
}

std::vector<Eigen::Vector3d> outward_normals(const WeldedSurface& surface, const SurfaceParts& parts) {
  std::vector<Eigen::Vector3d> normals(surface.places.size(), Eigen::Vector3d::Zero());
  for (const Triangle& face : surface.faces) {
    const std::size_t part = at(parts.of_place[at(face[0])]);
    const Eigen::Vector3d vector = area_vector(surface, face);
    const bool inverted = parts.volumes[part] < 0.0 && parts.encloses_space(part);
    for (const std::int32_t place : face) normals[at(place)] += inverted ? Eigen::Vector3d(-vector) : vector;
  }
  for (Eigen::Vector3d& normal : normals) {
    const double length = normal.stableNorm();
    normal = length > 0.0 ? Eigen::Vector3d(normal / length) : Eigen::Vector3d::Zero();
  }
  return normals;
}

}  // namespace anigen::rig
