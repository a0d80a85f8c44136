#pragma once
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skeleton.h"
#include "anigen/io/image.h"

/// Small assets whose pictures can be worked out by hand.
namespace anigen::test {

/// Closed sphere around the origin, faces counter-clockwise from outside.
inline Asset sphere(float radius, int rings = 48, int segments = 96) {
  Asset asset;
  asset.name = "sphere";
  constexpr float kPi = 3.14159265f;
  for (int r = 0; r <= rings; ++r) {
    for (int s = 0; s <= segments; ++s) {
      const float polar = kPi * static_cast<float>(r) / static_cast<float>(rings);
      const float around = 2 * kPi * static_cast<float>(s) / static_cast<float>(segments);
      const Eigen::Vector3f n(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around), std::cos(polar));
      asset.mesh.vertices.push_back(radius * n);
      asset.mesh.normals.push_back(n);
    }
  }
  const auto at = [&](int r, int s) { return static_cast<std::int32_t>(r * (segments + 1) + s); };
  for (int r = 0; r < rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      asset.mesh.faces.push_back({at(r, s), at(r + 1, s), at(r + 1, s + 1)});
      asset.mesh.faces.push_back({at(r, s), at(r + 1, s + 1), at(r, s + 1)});
    }
  }
  return asset;
}

/// The square [-1, 1]² in the plane y = 0 facing the viewer at yaw 0, with texture coordinates as a picture hung on a
/// wall: u to the right, v down.
inline Asset wall() {
  Asset asset;
  asset.name = "wall";
  asset.mesh.vertices = {{-1, 0, 1}, {-1, 0, -1}, {1, 0, -1}, {1, 0, 1}};
  asset.mesh.uvs = {{0, 0}, {0, 1}, {1, 1}, {1, 0}};
  asset.mesh.faces = {{0, 1, 2}, {0, 2, 3}};
  return asset;
}

/// Hangs a picture on the wall.
inline Asset wall_with(const io::Image& image) {
  Asset asset = wall();
  asset.images.push_back({"picture", "image/png", io::encode_png(image)});
  Material material;
  material.image = 0;
  asset.materials.push_back(material);
  asset.mesh.face_materials = {0, 0};
  return asset;
}

}  // namespace anigen::test
