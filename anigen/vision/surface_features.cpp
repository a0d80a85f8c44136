#include "anigen/vision/surface_features.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "anigen/core/parallel.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/render/scene.h"
#include "anigen/render/surface_color.h"
#include "anigen/vision/voxel_features.h"

namespace anigen::vision {

namespace {

constexpr std::size_t kRays = 32;

// Van der Corput sequence in base 2: the bits of i behind the point, mirrored.
double radical_inverse(std::size_t i) {
  double value = 0.0;
  for (double digit = 0.5; i > 0; i >>= 1, digit /= 2.0) value += static_cast<double>(i & 1) * digit;
  return value;
}

// Directions about +z with a density proportional to the cosine, from Hammersley's points (Malley's method).
const std::array<Eigen::Vector3d, kRays>& hemisphere() {
  static const std::array<Eigen::Vector3d, kRays> directions = [] {
    constexpr double kTurn = 6.283185307179586;
    std::array<Eigen::Vector3d, kRays> list;
    for (std::size_t i = 0; i < kRays; ++i) {
      const double squared = (static_cast<double>(i) + 0.5) / kRays, angle = kTurn * radical_inverse(i);
      const double radius = std::sqrt(squared);
      list[i] = {radius * std::cos(angle), radius * std::sin(angle), std::sqrt(1.0 - squared)};
    }
    return list;
  }();
  return directions;
}

// A rotation that takes +z to the normal (Duff et al. 2017, "Building an orthonormal basis, revisited").
Eigen::Matrix3d frame_about(const Eigen::Vector3d& n) {
  const double sign = std::copysign(1.0, n.z()), a = -1.0 / (sign + n.z()), b = n.x() * n.y() * a;
  Eigen::Matrix3d frame;
  frame.col(0) = Eigen::Vector3d(1.0 + sign * n.x() * n.x() * a, sign * b, -sign * n.x());
  frame.col(1) = Eigen::Vector3d(b, sign + n.y() * n.y() * a, -n.y());
  frame.col(2) = n;
  return frame;
}

double capped(const std::optional<double>& distance) { return std::min(distance.value_or(1.0), 1.0); }

using Eigen::Vector3d;

struct Foot {
  Vector3d position = Vector3d::Zero(), normal = Vector3d::UnitZ(), color = Vector3d::Zero();
};

// Smooth normals as the renderer sees them, but not turned towards any viewer.
class SmoothNormals {
 public:
  explicit SmoothNormals(const Mesh& mesh)
      : mesh_(&mesh), normals_(mesh.normals.empty() ? vertex_normals(mesh.vertices, mesh.faces) : mesh.normals) {}

  Vector3d at(const geometry::SurfacePoint& place) const {
    const Triangle& face = mesh_->faces[static_cast<std::size_t>(place.face)];
    const auto corner = [&](std::size_t k) { return static_cast<std::size_t>(face[k]); };
    Vector3d smooth = Vector3d::Zero();
    for (std::size_t k = 0; k < 3; ++k)
      smooth += place.barycentric[static_cast<Eigen::Index>(k)] * normals_[corner(k)].cast<double>();
    if (smooth.norm() > 1e-6) return smooth.normalized();
    const Vector3d a = mesh_->vertices[corner(0)].cast<double>();
    const Vector3d flat = (mesh_->vertices[corner(1)].cast<double>() - a)
                              .cross(mesh_->vertices[corner(2)].cast<double>() - a)
                              .stableNormalized();
    return flat.norm() > 0.5 ? flat : Vector3d::UnitZ();
  }

 private:
  const Mesh* mesh_;
  std::vector<Eigen::Vector3f> normals_;
};

std::vector<Foot> feet_of(const Asset& asset, const std::vector<Vector3d>& centers) {
  const render::Scene scene(asset);  // also checks the lengths and numbers of every array of the mesh
  const render::SurfaceColor colors(scene, {});
  const SmoothNormals normals(asset.mesh);
  const std::vector<geometry::NearestPoint> nearest = geometry::NearestSurface(asset.mesh).query(centers);
  std::vector<Foot> feet(centers.size());
  parallel_for(feet.size(), [&](std::size_t i) {
    render::Hit hit;
    hit.face = nearest[i].at.face;
    hit.barycentric = nearest[i].at.barycentric.cast<float>();
    feet[i] = {nearest[i].position, normals.at(nearest[i].at), colors.at(hit).cast<double>()};
  });
  return feet;
}

// Change of normals with distance; the curvature of a sphere is 1 / radius. Voxels whose
// normal points the other way belong to another sheet; feet closer than a quarter edge would only add noise.
double mean_curvature(std::size_t self, const std::vector<std::size_t>& around, const std::vector<Foot>& feet,
                      double edge) {
  double sum = 0.0;
  int count = 0;
  for (const std::size_t other : around) {
    const Vector3d way = feet[other].position - feet[self].position;
    if (way.norm() < 0.25 * edge || feet[other].normal.dot(feet[self].normal) <= 0.0) continue;
    sum += (feet[other].normal - feet[self].normal).dot(way) / way.squaredNorm();
    ++count;
  }
  return count > 0 ? sum / count * edge : 0.0;
}

double bend(const std::vector<std::size_t>& around, const std::vector<Foot>& feet) {
  Vector3d sum = Vector3d::Zero();
  for (const std::size_t other : around) sum += feet[other].normal;
  return 1.0 - sum.norm() / static_cast<double>(around.size());
}

float unit(double value) { return static_cast<float>(std::clamp(value, 0.0, 1.0)); }
float signed_unit(double value) { return static_cast<float>(std::clamp(value, -1.0, 1.0)); }

}  // namespace

SurfaceSight look_around(const geometry::RayCaster& caster, const Eigen::Vector3d& foot, const Eigen::Vector3d& normal,
                         double lift, double near_radius, double far_radius) {
  const Eigen::Matrix3d frame = frame_about(normal);
  const Eigen::Vector3d above = foot + lift * normal;
  int near_free = 0, far_free = 0;
  for (const Eigen::Vector3d& direction : hemisphere()) {
    const double way = caster.first_hit(above, frame * direction).value_or(std::numeric_limits<double>::infinity());
    near_free += way > near_radius ? 1 : 0;
    far_free += way > far_radius ? 1 : 0;
  }
  SurfaceSight sight;
  sight.near_openness = static_cast<double>(near_free) / kRays;
  sight.far_openness = static_cast<double>(far_free) / kRays;
  sight.thickness = capped(caster.first_hit(foot, -normal, lift));
  sight.gap = capped(caster.first_hit(foot, normal, lift));
  return sight;
}

std::vector<SurfaceFeature> surface_features(const Asset& asset, const std::vector<geometry::Voxel>& voxels,
                                             int resolution) {
  const VoxelNeighbours neighbours(voxels, resolution);
  std::vector<Vector3d> centers;
  for (const geometry::Voxel& voxel : voxels) centers.push_back(geometry::voxel_center(voxel, resolution));
  const std::vector<Foot> feet = feet_of(asset, centers);
  const geometry::RayCaster caster(asset.mesh);
  const double edge = 1.0 / resolution;

  std::vector<SurfaceFeature> features(voxels.size());
  parallel_for(voxels.size(), [&](std::size_t i) {
    const Foot& foot = feet[i];
    const SurfaceSight sight = look_around(caster, foot.position, foot.normal, 0.1 * edge, kNearRadius, kFarRadius);
    const std::vector<std::size_t> around = neighbours.within(voxels[i], 1);
    SurfaceFeature& row = features[i];
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const auto c = static_cast<std::size_t>(axis);
      row[c] = signed_unit((foot.position[axis] - centers[i][axis]) / edge);
      row[3 + c] = signed_unit(foot.normal[axis]);
      row[6 + c] = unit(foot.color[axis]);
    }
    row[9] = unit(sight.near_openness);
    row[10] = unit(sight.far_openness);
    row[11] = unit(sight.thickness);
    row[12] = unit(sight.gap);
    row[13] = signed_unit(mean_curvature(i, around, feet, edge));
    row[14] = unit(bend(around, feet));
    row[15] = unit(static_cast<double>(neighbours.within(voxels[i], 2).size()) / 125.0);
  });
  return features;
}

io::NdArray SurfaceFeatures::extract(const prepare::FeatureRequest& request) const {
  const std::vector<SurfaceFeature> rows = surface_features(request.asset, request.voxels, request.resolution);
  io::NdArray array;
  array.dtype = io::Dtype::kF16;
  array.shape = {static_cast<std::int64_t>(rows.size()), kSurfaceChannels};
  array.bytes.reserve(rows.size() * kSurfaceChannels * sizeof(std::uint16_t));
  for (const SurfaceFeature& row : rows) {
    for (const float value : row) {
      const std::uint16_t half = io::float_to_half(value);
      array.bytes.push_back(static_cast<std::uint8_t>(half & 0xFF));
      array.bytes.push_back(static_cast<std::uint8_t>(half >> 8));
    }
  }
  return array;
}

}  // namespace anigen::vision
