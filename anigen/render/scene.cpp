#include "anigen/render/scene.h"

#include <Eigen/Geometry>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/mesh_check.h"
#include "anigen/geometry/triangle_tree.h"
#include "anigen/render/picture.h"

namespace anigen::render {

namespace {

constexpr double kRadians = kPi / 180.0;

Box target_box(const Orbit& orbit, const std::vector<Eigen::Vector3f>& points) {
  Box box = orbit.fit ? *orbit.fit : bounding_box(points);
  if (box.empty()) {
    box.low.setConstant(-0.5);
    box.high.setConstant(0.5);
  }
  if (!box.low.allFinite() || !box.high.allFinite()) throw InputError("", "fit", "the box to look at is not finite");
  return box;
}

Camera oriented(const Orbit& orbit, int width, int height) {
  require_between(orbit.yaw_degrees, -1e6, 1e6, "yaw_degrees");
  require_between(orbit.pitch_degrees, -90.0, 90.0, "pitch_degrees");
  require_between(orbit.fov_degrees, 1.0, 150.0, "fov_degrees");
  require_between(orbit.margin, 0.01, 100.0, "margin");
  require_between(width, 1, 16384, "width");
  require_between(height, 1, 16384, "height");
  const double yaw = orbit.yaw_degrees * kRadians, pitch = orbit.pitch_degrees * kRadians;
  Camera camera;
  camera.right = {std::cos(yaw), std::sin(yaw), 0.0};
  camera.forward = {-std::sin(yaw) * std::cos(pitch), std::cos(yaw) * std::cos(pitch), -std::sin(pitch)};
  camera.up = camera.right.cross(camera.forward);
  camera.tangent = std::tan(0.5 * orbit.fov_degrees * kRadians);
  camera.width = width;
  camera.height = height;
  return camera;
}

/// Position of the eye for everything to lie inside the frustum, relative to the target and along the camera's axes.
struct Placement {
  double right = 0.0, up = 0.0, back = 0.0;
};

/// Every point gives one bound per side plane of the frustum; the tightest eye position follows in closed form.
/// @param centred keep the eye on the axis through the target, else shift it so that opposite sides are as near
Placement fit(const Camera& camera, const Orbit& orbit, const Box& box, const std::vector<Eigen::Vector3f>& points,
              bool centred) {
  const double tangent_y = camera.tangent / orbit.margin;
  const double tangent_x = tangent_y * camera.width / camera.height;
  double right = -1e300, left = -1e300, above = -1e300, below = -1e300;
  const auto include = [&](const Eigen::Vector3d& point) {
    const Eigen::Vector3d offset = point - box.center();
    const double x = offset.dot(camera.right), y = offset.dot(camera.up), z = -offset.dot(camera.forward);
    right = std::max(right, x + z * tangent_x);
    left = std::max(left, -x + z * tangent_x);
    above = std::max(above, y + z * tangent_y);
    below = std::max(below, -y + z * tangent_y);
  };
  if (orbit.fit || points.empty()) {
    for (int corner = 0; corner < 8; ++corner) {
      include({corner & 1 ? box.high.x() : box.low.x(), corner & 2 ? box.high.y() : box.low.y(),
               corner & 4 ? box.high.z() : box.low.z()});
    }
  } else {
    for (const Eigen::Vector3f& point : points) include(point.cast<double>());
  }
  Placement place;
  if (centred) {
    place.back = std::max(std::max(right, left) / tangent_x, std::max(above, below) / tangent_y);
  } else {
    place.right = 0.5 * (right - left);
    place.up = 0.5 * (above - below);
    place.back = std::max(0.5 * (right + left) / tangent_x, 0.5 * (above + below) / tangent_y);
  }
  if (!(place.back > 0.0)) place.back = 1.0;  // a single point
  return place;
}

template <typename Array>
void check_length(const Asset& asset, const Array& array, std::size_t expected, const char* name) {
  if (array.empty() || array.size() == expected) return;
  throw InputError(asset.name, std::string("mesh.") + name,
                   std::to_string(array.size()) + " entries, expected " + std::to_string(expected));
}

template <typename Array>
void check_finite(const Asset& asset, const Array& array, const char* name) {
  for (std::size_t i = 0; i < array.size(); ++i) {
    if (!array[i].allFinite()) {
      throw InputError(asset.name, std::string("mesh.") + name + "[" + std::to_string(i) + "]",
                       "the value is not finite");
    }
  }
}

void check(const Asset& asset, const std::vector<Eigen::Vector3f>& vertices) {
  const Mesh& mesh = asset.mesh;
  if (vertices.size() != mesh.vertices.size()) {
    throw InputError(
        asset.name, "posed vertices",
        std::to_string(vertices.size()) + " positions for " + std::to_string(mesh.vertices.size()) + " vertices");
  }
  geometry::check_mesh(vertices, mesh.faces, asset.name);
  check_length(asset, mesh.normals, vertices.size(), "normals");
  check_length(asset, mesh.uvs, vertices.size(), "uvs");
  check_length(asset, mesh.colors, vertices.size(), "colors");
  check_length(asset, mesh.face_materials, mesh.faces.size(), "face_materials");
  check_finite(asset, mesh.normals, "normals");
  check_finite(asset, mesh.uvs, "uvs");
  check_finite(asset, mesh.colors, "colors");
}

}  // namespace

Eigen::Vector3d Camera::ray(double x, double y) const {
  const double scale = 2.0 * tangent / height;
  return forward + (x - 0.5 * width) * scale * right - (y - 0.5 * height) * scale * up;
}

Eigen::Vector3d Camera::project(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d offset = point - eye;
  const double depth = offset.dot(forward);
  const double scale = 0.5 * height / (tangent * depth);
  return {0.5 * width + offset.dot(right) * scale, 0.5 * height - offset.dot(up) * scale, depth};
}

Camera orbit_camera(const Orbit& orbit, const std::vector<Eigen::Vector3f>& points, int width, int height) {
  Camera camera = oriented(orbit, width, height);
  const Box box = target_box(orbit, points);
  Placement place;
  if (orbit.distance) {
    require_between(*orbit.distance, 1e-12, 1e16, "distance");
    place.back = *orbit.distance;
  } else {
    place = fit(camera, orbit, box, points, orbit.fit.has_value());
  }
  camera.eye = box.center() + place.right * camera.right + place.up * camera.up - place.back * camera.forward;
  return camera;
}

double centred_distance(const Orbit& orbit, const std::vector<Eigen::Vector3f>& points, int width, int height) {
  return fit(oriented(orbit, width, height), orbit, target_box(orbit, points), points, true).back;
}

struct Scene::Implementation {
  Implementation(const Asset& a, std::vector<Eigen::Vector3f> v, std::vector<Eigen::Vector3f> n)
      : asset(&a), vertices(std::move(v)), normals(std::move(n)), tree(vertices, a.mesh.faces) {
    // Vertices that no face uses are not part of the picture.
    for (const Triangle& face : a.mesh.faces) {
      for (const std::int32_t index : face) box.extend(vertices[at(index)].cast<double>());
    }
    if (!box.empty()) {
      const double farthest = box.low.cwiseAbs().cwiseMax(box.high.cwiseAbs()).maxCoeff();
      epsilon = static_cast<float>(1e-5 * box.diagonal() + 1e-6 * farthest);
    }
  }

  Hit describe(const geometry::TreeHit& found, const Eigen::Vector3f& view) const {
    Hit hit;
    hit.face = static_cast<std::int32_t>(found.face);
    hit.distance = found.distance;
    hit.barycentric = {1.0f - found.u - found.v, found.u, found.v};
    const Triangle& face = asset->mesh.faces[found.face];
    const auto corner = [&](std::size_t k) { return static_cast<std::size_t>(face[k]); };
    hit.flat_normal =
        (vertices[corner(1)] - vertices[corner(0)]).cross(vertices[corner(2)] - vertices[corner(0)]).stableNormalized();
    hit.front = hit.flat_normal.dot(view) <= 0.0f;
    hit.normal.setZero();
    for (std::size_t k = 0; k < 3; ++k)
      hit.normal += hit.barycentric[static_cast<Eigen::Index>(k)] * normals[corner(k)];
    if (!hit.front) {
      hit.flat_normal = -hit.flat_normal;
      hit.normal = -hit.normal;
    }
    const float length = hit.normal.norm();
    hit.normal = length > 1e-6f ? Eigen::Vector3f(hit.normal / length) : hit.flat_normal;
    // Some files wind faces against their normals: the side that is seen decides.
    if (hit.normal.dot(hit.flat_normal) < -0.2f) hit.normal = -hit.normal;
    return hit;
  }

  const Asset* asset;
  std::vector<Eigen::Vector3f> vertices, normals;
  geometry::TriangleTree tree;
  Box box;
  float epsilon = 0.0f;  ///< how far secondary rays start off the surface
};

Scene::Scene(const Asset& asset, const std::optional<std::vector<Eigen::Vector3f>>& posed) {
  const Mesh& mesh = asset.mesh;
  const std::vector<Eigen::Vector3f>& vertices = posed ? *posed : mesh.vertices;
  check(asset, vertices);
  std::vector<Eigen::Vector3f> normals;
  if (posed) {
    geometry::check_mesh(mesh.vertices, mesh.faces, asset.name);
    normals = posed_normals(mesh, vertices);
  } else {
    normals = mesh.normals.empty() ? vertex_normals(vertices, mesh.faces) : mesh.normals;
  }
  implementation_ = std::make_unique<Implementation>(asset, vertices, std::move(normals));
}

Scene::~Scene() = default;
Scene::Scene(Scene&&) noexcept = default;
Scene& Scene::operator=(Scene&&) noexcept = default;

Hit Scene::trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double nearest) const {
  const geometry::TreeHit hit =
      implementation_->tree.first_hit({origin.cast<float>(), direction.cast<float>(), static_cast<float>(nearest)});
  return hit.found() ? implementation_->describe(hit, direction.cast<float>()) : Hit();
}

std::array<Hit, Scene::kBundle> Scene::trace(const Eigen::Vector3d& origin,
                                             const std::array<Eigen::Vector3f, kBundle>& directions) const {
  static_assert(kBundle == geometry::kRayBundle, "the tree is asked with bundles");
  const geometry::BundleHits found = implementation_->tree.first_hits(origin.cast<float>(), directions);
  std::array<Hit, kBundle> hits;
  for (std::size_t i = 0; i < kBundle; ++i) {
    if (found[i].found()) hits[i] = implementation_->describe(found[i], directions[i]);
  }
  return hits;
}

bool Scene::occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float distance) const {
  return implementation_->tree.is_blocked({origin, direction, implementation_->epsilon, distance});
}

Eigen::Vector3f Scene::shadow_origin(const Hit& hit) const {
  const Triangle& face = implementation_->asset->mesh.faces[at(hit.face)];
  std::array<Eigen::Vector3f, 3> corners;
  Eigen::Vector3f point = Eigen::Vector3f::Zero();
  for (std::size_t k = 0; k < 3; ++k) {
    corners[k] = implementation_->vertices[at(face[k])];
    point += hit.barycentric[static_cast<Eigen::Index>(k)] * corners[k];
  }
  Eigen::Vector3f lifted = point;
  for (std::size_t k = 0; k < 3; ++k) {
    Eigen::Vector3f normal = implementation_->normals[at(face[k])];
    if (normal.dot(hit.flat_normal) < 0.0f) normal = -normal;
    const float below = std::min(0.0f, (point - corners[k]).dot(normal));
    lifted -= hit.barycentric[static_cast<Eigen::Index>(k)] * below * normal;
  }
  return lifted + implementation_->epsilon * hit.flat_normal;
}

const Asset& Scene::asset() const { return *implementation_->asset; }
const std::vector<Eigen::Vector3f>& Scene::vertices() const { return implementation_->vertices; }
const Box& Scene::box() const { return implementation_->box; }
float Scene::epsilon() const { return implementation_->epsilon; }

}  // namespace anigen::render
