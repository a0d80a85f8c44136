#include "anigen/geometry/inside.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <tuple>
#include <utility>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::geometry {

namespace {

constexpr double kInsideFrom = 0.5;

// Number of each vertex, equal for those at one position.
std::vector<std::size_t> places_of(const std::vector<Eigen::Vector3f>& vertices) {
  std::map<std::tuple<float, float, float>, std::size_t> numbers;
  std::vector<std::size_t> places;
  for (const Eigen::Vector3f& v : vertices) {
    // NaN would break the order; such vertices belong to no face that counts.
    const auto key = v.allFinite() ? std::make_tuple(v.x(), v.y(), v.z()) : std::make_tuple(0.0F, 0.0F, 0.0F);
    places.push_back(numbers.emplace(key, numbers.size()).first->second);
  }
  return places;
}

bool counts(const Triangle& face, const std::vector<Eigen::Vector3f>& vertices) {
  return std::all_of(face.begin(), face.end(), [&](std::int32_t corner) {
    return corner >= 0 && static_cast<std::size_t>(corner) < vertices.size() &&
           vertices[static_cast<std::size_t>(corner)].allFinite();
  });
}

}  // namespace

InsideTest::InsideTest(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  const std::vector<std::size_t> places = places_of(vertices);
  DisjointSets joined(places.size());
  std::vector<std::pair<std::size_t, std::size_t>> order;  // part, face
  const auto place = [&](const Triangle& face, std::size_t i) { return places[static_cast<std::size_t>(face[i])]; };
  for (const Triangle& face : faces) {
    if (!counts(face, vertices)) continue;
    joined.join(place(face, 0), place(face, 1));
    joined.join(place(face, 0), place(face, 2));
  }
  for (std::size_t f = 0; f < faces.size(); ++f) {
    if (counts(faces[f], vertices)) order.emplace_back(joined.find(place(faces[f], 0)), f);
  }
  std::sort(order.begin(), order.end());
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (i == 0 || order[i].first != order[i - 1].first) parts_.push_back({i, i});
    ++parts_.back().end;
    const auto corner = [&](std::size_t k) {
      return Eigen::Vector3d(vertices[static_cast<std::size_t>(faces[order[i].second][k])].cast<double>());
    };
    corners_.push_back({corner(0), corner(1), corner(2)});
    for (const Eigen::Vector3d& p : {corners_.back().a, corners_.back().b, corners_.back().c}) box_.extend(p);
  }
}

// Of one triangle tan(Ω/2) = a · (b × c) / (|a||b||c| + (a · b)|c| + (b · c)|a| + (c · a)|b|), corners from the point
// (van Oosterom and Strackee 1983).
double InsideTest::winding_number(const Eigen::Vector3d& point, const Part& part) const {
  double half_angles = 0.0;
  for (std::size_t i = part.begin; i < part.end; ++i) {
    const Eigen::Vector3d a = corners_[i].a - point, b = corners_[i].b - point, c = corners_[i].c - point;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    half_angles += std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return half_angles / (2.0 * EIGEN_PI);
}

double InsideTest::winding_number(const Eigen::Vector3d& point) const {
  return winding_number(point, {0, corners_.size()});
}

bool InsideTest::contains(const Eigen::Vector3d& point, double margin) const {
  if (corners_.empty() || !point.allFinite()) return false;
  const Eigen::Array3d low = box_.low.array() - margin, high = box_.high.array() + margin;
  if ((point.array() < low).any() || (point.array() > high).any()) return false;
  double whole = 0.0;
  for (const Part& part : parts_) {
    const double one = winding_number(point, part);
    if (std::abs(one) >= kInsideFrom) return true;
    whole += one;
  }
  if (std::abs(whole) >= kInsideFrom) return true;
  return std::any_of(corners_.begin(), corners_.end(), [&](const Corners& face) {
    const Eigen::Array3d least = face.a.cwiseMin(face.b).cwiseMin(face.c).array() - margin,
                         most = face.a.cwiseMax(face.b).cwiseMax(face.c).array() + margin;
    if ((point.array() < least).any() || (point.array() > most).any()) return false;
    return nearest_on_triangle(point, face.a, face.b, face.c).distance <= margin;
  });
}

std::vector<bool> InsideTest::inside(const std::vector<Eigen::Vector3d>& points, double margin) const {
  std::vector<char> found(points.size(), 0);  // bits of a vector<bool> cannot be written at once
  parallel_for(points.size(), [&](std::size_t i) { found[i] = contains(points[i], margin) ? 1 : 0; });
  return {found.begin(), found.end()};
}

}  // namespace anigen::geometry
