#include "anigen/geometry/primitives.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/bones.h"

namespace anigen::geometry {

namespace {

struct Sphere {
  std::vector<Eigen::Vector3d> directions;  ///< unit
  std::vector<Triangle> faces;
};

Sphere icosahedron() {
  Sphere sphere;
  const double golden = 0.5 * (1.0 + std::sqrt(5.0));
  for (int axis = 0; axis < 3; ++axis) {
    for (const double one : {-1.0, 1.0}) {
      for (const double long_side : {-golden, golden}) {
        Eigen::Vector3d corner = Eigen::Vector3d::Zero();
        corner[axis] = one;
        corner[(axis + 1) % 3] = long_side;
        sphere.directions.push_back(corner.normalized());
      }
    }
  }
  // Faces are the triples at the least distance from each other; edges are 2 / √(1 + φ²) = 1.05 long.
  const auto are_near = [&](std::size_t a, std::size_t b) {
    return (sphere.directions[a] - sphere.directions[b]).norm() < 1.1;
  };
  for (std::size_t a = 0; a < sphere.directions.size(); ++a) {
    for (std::size_t b = a + 1; b < sphere.directions.size(); ++b) {
      for (std::size_t c = b + 1; c < sphere.directions.size(); ++c) {
        if (!are_near(a, b) || !are_near(b, c) || !are_near(c, a)) continue;
        const auto &p = sphere.directions[a], &q = sphere.directions[b], &r = sphere.directions[c];
        Triangle face{static_cast<std::int32_t>(a), static_cast<std::int32_t>(b), static_cast<std::int32_t>(c)};
        if ((q - p).cross(r - p).dot(p) < 0.0) std::swap(face[1], face[2]);
        sphere.faces.push_back(face);
      }
    }
  }
  return sphere;
}

void subdivide(Sphere& sphere) {
  std::map<std::pair<std::int32_t, std::int32_t>, std::int32_t> middles;
  const auto middle = [&](std::int32_t a, std::int32_t b) {
    const auto [known, is_new] =
        middles.emplace(std::minmax(a, b), static_cast<std::int32_t>(sphere.directions.size()));
    if (is_new) sphere.directions.push_back((sphere.directions[at(a)] + sphere.directions[at(b)]).normalized());
    return known->second;
  };
  std::vector<Triangle> faces;
  for (const auto& [a, b, c] : sphere.faces) {
    const std::int32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
    faces.insert(faces.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
  }
  sphere.faces = std::move(faces);
}

constexpr double kJointRadius = 0.02, kBoneRadius = 0.01;  // of the skeleton's size
constexpr double kShortest = 1e-5;
constexpr int kSubdivisions = 2, kSections = 32;

Eigen::Vector4f color(int red, int green, int blue) {
  return {static_cast<float>(red) / 255.0f, static_cast<float>(green) / 255.0f, static_cast<float>(blue) / 255.0f,
          1.0f};
}

void append(SkeletonMesh& skeleton, const Mesh& part, const Eigen::Vector3d& offset, const Eigen::Vector4f& paint,
            int joint) {
  const auto first = static_cast<std::int32_t>(skeleton.mesh.vertices.size());
  for (const Eigen::Vector3f& vertex : part.vertices) {
    skeleton.mesh.vertices.push_back((vertex.cast<double>() + offset).cast<float>());
    skeleton.mesh.colors.push_back(paint);
    skeleton.skin.append_row({{joint, 1.0f}});
  }
  for (const auto& [a, b, c] : part.faces) skeleton.mesh.faces.push_back({a + first, b + first, c + first});
}

void check(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents) {
  if (joints.empty()) throw InputError("", "joints", "there are none");
  check_joints(joints, parents);
}

}  // namespace

Mesh icosphere(int subdivisions, double radius) {
  require_between(subdivisions, 0, 8, "subdivisions");
  Sphere sphere = icosahedron();
  for (int i = 0; i < subdivisions; ++i) subdivide(sphere);
  Mesh mesh;
  for (const Eigen::Vector3d& direction : sphere.directions)
    mesh.vertices.push_back((radius * direction).cast<float>());
  mesh.faces = std::move(sphere.faces);
  return mesh;
}

Mesh cone(const Eigen::Vector3d& base, const Eigen::Vector3d& apex, double radius, int sections) {
  if (sections < 3) throw InputError("", "sections", "must be at least 3");
  const Eigen::Vector3d axis = apex - base;
  if (!(axis.norm() > 0.0)) throw InputError("", "cone", "its base and its apex are the same point");
  const Eigen::Vector3d right = axis.unitOrthogonal(), up = axis.normalized().cross(right);
  Mesh mesh;
  mesh.vertices = {base.cast<float>(), apex.cast<float>()};
  for (int i = 0; i < sections; ++i) {
    const double angle = 2.0 * kPi * i / sections;
    mesh.vertices.push_back((base + radius * (std::cos(angle) * right + std::sin(angle) * up)).cast<float>());
    const std::int32_t here = 2 + i, next = 2 + (i + 1) % sections;
    mesh.faces.push_back({0, next, here});
    mesh.faces.push_back({1, here, next});
  }
  return mesh;
}

SkeletonMesh skeleton_mesh(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents) {
  check(joints, parents);
  Box box;
  for (const Eigen::Vector3d& joint : joints) box.extend(joint);
  const double size = box.diagonal() < kShortest ? 1.0 : box.diagonal();
  SkeletonMesh skeleton;
  const Mesh ball = icosphere(kSubdivisions, kJointRadius * size);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    append(skeleton, ball, joints[j], color(230, 180, 80), static_cast<int>(j));
    const int parent = parents[j];
    if (parent < 0 || (joints[j] - joints[at(parent)]).norm() < kShortest) continue;
    append(skeleton, cone(joints[at(parent)], joints[j], kBoneRadius * size, kSections), Eigen::Vector3d::Zero(),
           color(160, 180, 200), parent);
  }
  return skeleton;
}

Asset skeleton_asset(const Skeleton& skeleton) {
  SkeletonMesh solid = skeleton_mesh(skeleton.positions(), skeleton.parents);
  Asset shown;
  shown.name = "skeleton";
  shown.skeleton = skeleton;
  shown.mesh = std::move(solid.mesh);
  shown.skin = std::move(solid.skin);
  shown.mesh.normals = vertex_normals(shown.mesh.vertices, shown.mesh.faces);
  return shown;
}

}  // namespace anigen::geometry
