#include "anigen/io/gltf/export_materials.h"

#include <algorithm>
#include <set>

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

// From the first bytes, since the format demands that the declared type matches them; glTF knows no other types.
const char* mime_type(const EncodedImage& image, const std::string& file) {
  static constexpr unsigned char kPng[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
  static constexpr unsigned char kJpeg[] = {0xFF, 0xD8, 0xFF};
  const auto starts_with = [&](const unsigned char* magic, std::size_t length) {
    return image.bytes.size() >= length && std::equal(magic, magic + length, image.bytes.begin());
  };
  if (starts_with(kPng, sizeof(kPng))) return "image/png";
  if (starts_with(kJpeg, sizeof(kJpeg))) return "image/jpeg";
  throw InputError(file, "", "image '" + image.name + "' of the asset is neither PNG nor JPEG");
}

int write_image(GltfDocument& document, const EncodedImage& image, const std::string& file) {
  const char* type = mime_type(image, file);
  Json entry = {{"bufferView", document.add_view(image.bytes.data(), image.bytes.size(), ViewTarget::kNone)},
                {"mimeType", type}};
  if (!image.name.empty()) entry["name"] = image.name;
  document.json["images"].push_back(std::move(entry));
  return static_cast<int>(document.json["images"].size()) - 1;
}

// One texture per image; both have the same index.
int texture_of(GltfDocument& document, const Asset& asset, int image, std::map<int, int>& textures,
               const std::string& file) {
  const auto known = textures.find(image);
  if (known != textures.end()) return known->second;
  const int source = write_image(document, asset.images[static_cast<std::size_t>(image)], file);
  document.json["textures"].push_back({{"source", source}});
  return textures[image] = source;
}

Json material_json(const Material& material) {
  Json factor = Json::array();
  for (int k = 0; k < 4; ++k) factor.push_back(static_cast<double>(std::clamp(material.base_color[k], 0.0f, 1.0f)));
  Json entry = Json::object();
  if (!material.name.empty()) entry["name"] = material.name;
  entry["pbrMetallicRoughness"] = {{"baseColorFactor", factor}, {"metallicFactor", 0.0}, {"roughnessFactor", 1.0}};
  if (material.double_sided) entry["doubleSided"] = true;
  return entry;
}

}  // namespace

std::map<int, int> write_materials(GltfDocument& document, const Asset& asset, const std::string& file) {
  const Mesh& mesh = asset.mesh;
  std::set<int> used(mesh.face_materials.begin(), mesh.face_materials.end());
  if (mesh.face_materials.empty()) used.insert(-1);
  std::map<int, int> index_in_file, textures;
  for (const int m : used) {
    Material plain;
    plain.name = "default";
    const Material& material = m < 0 ? plain : asset.materials[static_cast<std::size_t>(m)];
    Json entry = material_json(material);
    if (material.image >= 0 && !mesh.uvs.empty()) {
      const int texture = texture_of(document, asset, material.image, textures, file);
      entry["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", texture}};
    }
    index_in_file[m] = static_cast<int>(document.json["materials"].size());
    document.json["materials"].push_back(std::move(entry));
  }
  return index_in_file;
}

}  // namespace anigen::io
