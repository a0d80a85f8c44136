#include "anigen/rig/binding/heat_sources.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/ray_caster.h"
#include "anigen/geometry/segment.h"

namespace anigen::rig {
namespace {

constexpr double kEquallyNear = 1.0001;
constexpr double kSkinDepth = 0.002;   ///< how deep below the surface things still count as on it
constexpr double kLeastCosine = 0.5;   ///< between the way from the bone and the normal
constexpr double kLeastFacing = 0.05;  ///< a bone behind the surface is at most so many times farther: 1 / 0.05
constexpr double kFarthestSeen = 1e3;  ///< rays are in single precision

std::vector<Eigen::Vector3f> rounded(const WeldedSurface& surface) {
  std::vector<Eigen::Vector3f> vertices;
  vertices.reserve(surface.places.size());
  // Places without faces may lie anywhere, and are not part of the surface.
  for (const Eigen::Vector3d& place : surface.places) {
    vertices.push_back(place.cwiseMax(-1.0).cwiseMin(1.0).cast<float>());
  }
  return vertices;
}

/// Surface in at least five of the six directions along the axes: inside, also near a hole.
bool is_enclosed(const Eigen::Vector3d& point, const geometry::RayCaster& caster) {
  int hits = 0;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0})
      hits += caster.first_hit(point, sign * Eigen::Vector3d::Unit(axis)).has_value();
  }
  return hits >= 5;
}

/// Ends a made-up line where it comes out of the body, of whose parts it may cross several: a little before, so that
/// nobody sees it from outside.
void end_inside(BoneLine& line, const geometry::RayCaster& caster) {
  const Eigen::Vector3d along = line.end - line.start;
  const double length = along.norm();
  if (!(length > 0.0) || line.start.cwiseAbs().maxCoeff() > kFarthestSeen) return;
  constexpr double kStep = 2.0 * kSkinDepth;
  for (double reached = 0.0; reached < length;) {
    const std::optional<double> hit = caster.first_hit(line.start, along, reached);
    if (!hit || *hit >= length) return;
    if (!is_enclosed(line.start + along * ((*hit + kStep) / length), caster)) {
      line.end = line.start + along * (std::max(0.0, *hit - kStep) / length);
      return;
    }
    reached = *hit + kStep;
  }
}

/// The point of a joint's lines nearest to another.
Eigen::Vector3d nearest_point(const MovingBones& joint, const Eigen::Vector3d& place) {
  Eigen::Vector3d nearest = joint.lines.front().start;
  double least = std::numeric_limits<double>::infinity();
  for (const BoneLine& line : joint.lines) {
    const double t = geometry::nearest_on_segment(place, line.start, line.end);
    const Eigen::Vector3d point = line.start + t * (line.end - line.start);
    if ((point - place).norm() < least) {
      least = (point - place).norm();
      nearest = point;
    }
  }
  return nearest;
}

struct Visibility {
  const geometry::RayCaster* caster;
  const std::vector<Eigen::Vector3d>* normals;
  const SurfaceParts* parts;

  /// Between a place's normal and the way to it from elsewhere; on sheets whichever side is nearer to it.
  double cosine(std::size_t place, const Eigen::Vector3d& way) const {
    const double length = way.norm();
    if (!(length > 0.0)) return 1.0;
    const double cosine = (*normals)[place].dot(way) / length;
    return parts->encloses_space(at(parts->of_place[place])) ? cosine : std::abs(cosine);
  }

  /// Distance from a bone as the surface faces.
  double measure(std::size_t place, const Eigen::Vector3d& way) const {
    return way.norm() / std::max(kLeastFacing, 0.5 * (1.0 + cosine(place, way)));
  }

  bool sees(std::size_t place, const Eigen::Vector3d& position, const Eigen::Vector3d& bone) const {
    const Eigen::Vector3d outward = position - bone;
    const double distance = outward.norm();
    if (distance <= kSkinDepth) return true;
    if (distance > kFarthestSeen) return false;
    if (!(cosine(place, outward) > kLeastCosine)) return false;
    const std::optional<double> hit = caster->first_hit(position, -outward, std::min(kSkinDepth, 0.5 * distance));
    return !hit || *hit >= distance - kSkinDepth;
  }
};

}  // namespace

std::vector<HeatSource> heat_sources(const WeldedSurface& surface, const SurfaceParts& parts,
                                     std::vector<MovingBones> bones) {
  const geometry::RayCaster caster(rounded(surface), surface.faces);
  for (MovingBones& joint : bones) {
    if (joint.is_tip) end_inside(joint.lines.front(), caster);
  }
  const std::vector<Eigen::Vector3d> normals = outward_normals(surface, parts);
  const Visibility visibility{&caster, &normals, &parts};
  std::vector<HeatSource> sources(surface.places.size());
  parallel_for(sources.size(), [&](std::size_t p) {
    const Eigen::Vector3d& place = surface.places[p];
    std::vector<Eigen::Vector3d> points;
    std::vector<double> measures;
    points.reserve(bones.size());
    measures.reserve(bones.size());
    for (const MovingBones& joint : bones) {
      points.push_back(nearest_point(joint, place));
      measures.push_back(visibility.measure(p, place - points.back()));
    }
    HeatSource& source = sources[p];
    const auto least = std::min_element(measures.begin(), measures.end());
    source.distance = (place - points[static_cast<std::size_t>(least - measures.begin())]).norm();
    for (std::size_t j = 0; j < bones.size(); ++j) {
      if (measures[j] > kEquallyNear * *least) continue;
      source.joints.push_back(static_cast<std::int32_t>(j));
      source.visible.push_back(visibility.sees(p, place, points[j]));
    }
  });
  return sources;
}

}  // namespace anigen::rig
