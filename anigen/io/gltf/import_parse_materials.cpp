#include <algorithm>
#include <cmath>

#include "anigen/io/gltf/import_parse.h"

namespace anigen::io::gltf_import {
namespace {

// KHR_texture_transform: uv' = T · R · S · uv, with R turning by -rotation in a frame whose v points down.
void parse_texture_transform(const JsonPlace& extension, TextureUse& use) {
  if (const auto offset = extension.find("offset")) {
    const std::vector<double> o = offset->numbers(2);
    use.offset = {o[0], o[1]};
  }
  Eigen::Vector2d scale = Eigen::Vector2d::Ones();
  if (const auto member = extension.find("scale")) {
    const std::vector<double> s = member->numbers(2);
    scale = {s[0], s[1]};
  }
  double angle = 0.0;
  if (const auto rotation = extension.find("rotation")) angle = rotation->number();
  Eigen::Matrix2d rotation;
  rotation << std::cos(angle), std::sin(angle), -std::sin(angle), std::cos(angle);
  use.linear = rotation * scale.asDiagonal();
  use.set = static_cast<int>(extension.integer_or("texCoord", static_cast<std::uint64_t>(use.set), 255));
  use.is_transformed = true;
}

TextureUse parse_texture(const JsonPlace& place, std::size_t textures) {
  TextureUse use;
  use.texture = place.index("index", textures, "texture");
  use.set = static_cast<int>(place.integer_or("texCoord", 0, 255));
  if (const auto extensions = place.find("extensions")) {
    if (const auto transform = extensions->find("KHR_texture_transform")) parse_texture_transform(*transform, use);
  }
  return use;
}

void parse_base_color(const JsonPlace& place, const char* factor_key, const char* texture_key, std::size_t textures,
                      MaterialEntry& entry) {
  if (const auto factor = place.find(factor_key)) {
    const std::vector<double> f = factor->numbers(4);
    for (std::size_t i = 0; i < 4; ++i)
      entry.material.base_color[static_cast<Eigen::Index>(i)] = static_cast<float>(std::clamp(f[i], 0.0, 1.0));
  }
  if (const auto texture = place.find(texture_key)) entry.base_color = parse_texture(*texture, textures);
}

MaterialEntry parse_material(const JsonPlace& place, std::size_t textures) {
  MaterialEntry entry;
  entry.material.name = place.string_or("name", "");
  entry.material.double_sided = place.boolean_or("doubleSided", false);
  if (const auto pbr = place.find("pbrMetallicRoughness")) {
    parse_base_color(*pbr, "baseColorFactor", "baseColorTexture", textures, entry);
  } else if (const auto extensions = place.find("extensions")) {
    // The older model's diffuse colour is the closest thing to a base colour such a material has.
    if (const auto specular = extensions->find("KHR_materials_pbrSpecularGlossiness"))
      parse_base_color(*specular, "diffuseFactor", "diffuseTexture", textures, entry);
  }
  return entry;
}

}  // namespace

void parse_materials(const JsonPlace& root, Document& document, Notes& notes) {
  if (const auto images = root.find("images")) {
    for (std::size_t i = 0; i < images->size(); ++i) {
      const JsonPlace place = (*images)[i];
      ImageEntry image;
      image.pointer = place.pointer();
      image.name = place.string_or("name", "");
      image.mime_type = place.string_or("mimeType", "");
      image.uri = place.string_or("uri", "");
      image.view = place.index_or_none("bufferView", document.views.size(), "bufferView");
      document.images.push_back(std::move(image));
    }
  }
  if (const auto textures = root.find("textures")) {
    for (std::size_t i = 0; i < textures->size(); ++i) {
      const int source = (*textures)[i].index_or_none("source", document.images.size(), "image");
      if (source < 0) notes.tally("unsupported_texture", "textures without a PNG or JPEG source were left out");
      document.texture_images.push_back(source);
    }
  }
  if (const auto materials = root.find("materials")) {
    for (std::size_t i = 0; i < materials->size(); ++i)
      document.materials.push_back(parse_material((*materials)[i], document.texture_images.size()));
  }
}

}  // namespace anigen::io::gltf_import
