#include "anigen/io/gltf/export_mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "anigen/io/gltf/export_skin.h"

namespace anigen::io {
namespace {

std::vector<float> rotated(const std::vector<Eigen::Vector3f>& vectors, const Eigen::Matrix3d& rotation, bool unit) {
  std::vector<float> values;
  values.reserve(3 * vectors.size());
  for (const Eigen::Vector3f& v : vectors) {
    Eigen::Vector3d r = rotation * v.cast<double>();
    if (unit) {
      const double length = r.norm();
      // A normal without direction would make the file invalid; up is as good as any.
      r = length > 1e-12 ? Eigen::Vector3d(r / length) : Eigen::Vector3d::UnitY();
    }
    // The sum turns -0 into 0, which comparing tools and readers of the JSON bounds expect.
    for (int k = 0; k < 3; ++k) values.push_back(static_cast<float>(r[k]) + 0.0f);
  }
  return values;
}

Json write_attributes(GltfDocument& document, const Asset& asset, const Eigen::Matrix3d& rotation,
                      std::size_t influences) {
  const Mesh& mesh = asset.mesh;
  Json attributes = Json::object();
  const std::vector<float> positions = rotated(mesh.vertices, rotation, false);
  const int position = document.add_floats(positions, 3, ViewTarget::kVertices);
  document.set_bounds(position, positions, 3);
  attributes["POSITION"] = position;
  if (!mesh.normals.empty()) {
    attributes["NORMAL"] = document.add_floats(rotated(mesh.normals, rotation, true), 3, ViewTarget::kVertices);
  }
  if (!mesh.uvs.empty()) {
    std::vector<float> values;
    for (const Eigen::Vector2f& uv : mesh.uvs) values.insert(values.end(), {uv.x(), uv.y()});
    attributes["TEXCOORD_0"] = document.add_floats(values, 2, ViewTarget::kVertices);
  }
  if (!mesh.colors.empty()) {
    std::vector<float> values;
    for (const Eigen::Vector4f& color : mesh.colors) {
      for (int k = 0; k < 4; ++k) values.push_back(std::clamp(color[k], 0.0f, 1.0f));
    }
    attributes["COLOR_0"] = document.add_floats(values, 4, ViewTarget::kVertices);
  }
  if (asset.skeleton.size() > 0)
    write_skin_attributes(document, attributes, asset.skin, asset.skeleton.size(), influences);
  return attributes;
}

int write_indices(GltfDocument& document, const std::vector<std::uint32_t>& indices) {
  const std::uint32_t largest = *std::max_element(indices.begin(), indices.end());
  // 65535 itself restarts a strip in OpenGL and is forbidden.
  if (largest < std::numeric_limits<std::uint16_t>::max()) {
    return document.add_uint16({indices.begin(), indices.end()}, 1, ViewTarget::kIndices);
  }
  return document.add_uint32(indices, 1, ViewTarget::kIndices);
}

}  // namespace

void write_mesh(GltfDocument& document, const Asset& asset, const Eigen::Matrix3d& rotation,
                const std::map<int, int>& materials, std::size_t influences) {
  const Mesh& mesh = asset.mesh;
  const Json attributes = write_attributes(document, asset, rotation, influences);
  std::map<int, std::vector<std::uint32_t>> indices_by_material;
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    const int material = mesh.face_materials.empty() ? -1 : mesh.face_materials[f];
    std::vector<std::uint32_t>& indices = indices_by_material[material];
    for (const std::int32_t v : mesh.faces[f]) indices.push_back(static_cast<std::uint32_t>(v));
  }
  Json primitives = Json::array();
  for (const auto& [material, indices] : indices_by_material) {
    primitives.push_back({{"attributes", attributes},
                          {"indices", write_indices(document, indices)},
                          {"material", materials.at(material)},
                          {"mode", 4}});
  }
  Json entry = Json::object();
  if (!asset.name.empty()) entry["name"] = asset.name;
  entry["primitives"] = std::move(primitives);
  document.json["meshes"] = Json::array({std::move(entry)});
}

}  // namespace anigen::io
