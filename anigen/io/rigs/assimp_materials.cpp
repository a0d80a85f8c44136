#include "anigen/io/rigs/assimp_materials.h"

#include <assimp/material.h>

#include <algorithm>
#include <map>
#include <string>
#include <system_error>
#include <utility>

#include "anigen/io/rigs/assimp_document.h"

namespace anigen::io::assimp_import {
namespace {

namespace fs = std::filesystem;

/// What a uri may not hold as it is.
std::string percent_encoded(const std::string& path) {
  constexpr char kDigits[] = "0123456789ABCDEF";
  std::string uri;
  for (const char c : path) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte <= 0x20 || c == '%' || c == '\\' || c == ':' || byte == 0x7F) {
      uri += '%';
      uri += kDigits[byte >> 4];
      uri += kDigits[byte & 15];
    } else {
      uri += c;
    }
  }
  return uri;
}

/// The texture's place relative to the folder; when it is nowhere, its name.
fs::path find_texture(std::string named, const fs::path& folder) {
  std::replace(named.begin(), named.end(), '\\', '/');
  const fs::path given = fs::path(named).lexically_normal();
  const fs::path name = given.filename();
  const bool inside =
      given.is_relative() && !given.empty() && *given.begin() != ".." && named.find(':') == std::string::npos;
  for (const fs::path& place : {inside ? given : name, name, fs::path("textures") / name}) {
    std::error_code error;
    if (!place.empty() && fs::is_regular_file(folder / place, error)) return place;
  }
  return name;
}

class Textures {
 public:
  Textures(const aiScene& scene, const fs::path& folder, gltf_import::Document& document)
      : scene_(scene), folder_(folder), document_(document) {}

  /// @return its number among the document's textures, or -1
  int get(const std::string& path) {
    const auto [known, is_new] = known_.try_emplace(path, -1);
    if (is_new) known->second = add(path);
    return known->second;
  }

 private:
  int add(const std::string& path) {
    gltf_import::ImageEntry image;
    image.pointer = "texture " + path;
    const aiTexture* embedded = scene_.GetEmbeddedTexture(path.c_str());
    if (embedded != nullptr) {
      image.name = fs::path(embedded->mFilename.C_Str()).stem().string();
      // Raw pixels (height above 0) are no encoded picture: the stage that reads images says so.
      if (embedded->mHeight == 0 && embedded->pcData != nullptr) {
        image.view = DocumentArrays(document_).add_bytes(
            std::string(reinterpret_cast<const char*>(embedded->pcData), embedded->mWidth));
      }
    } else {
      const fs::path found = find_texture(path, folder_);
      if (found.empty()) return -1;
      image.name = found.stem().string();
      image.uri = percent_encoded(found.generic_string());
    }
    document_.images.push_back(std::move(image));
    document_.texture_images.push_back(static_cast<int>(document_.images.size()) - 1);
    return static_cast<int>(document_.texture_images.size()) - 1;
  }

  const aiScene& scene_;
  const fs::path& folder_;
  gltf_import::Document& document_;
  std::map<std::string, int> known_;
};

bool is_color(const aiColor4D& color) {
  for (const float c : {color.r, color.g, color.b}) {
    if (!(c >= 0.0f && c <= 1.0f)) return false;
  }
  return true;
}

}  // namespace

void add_materials(const aiScene& scene, const fs::path& folder, gltf_import::Document& document) {
  Textures textures(scene, folder, document);
  for (unsigned m = 0; m < scene.mNumMaterials; ++m) {
    const aiMaterial& from = *scene.mMaterials[m];
    gltf_import::MaterialEntry to;
    aiString text;
    if (from.Get(AI_MATKEY_NAME, text) == aiReturn_SUCCESS) to.material.name = text.C_Str();
    for (const aiTextureType type : {aiTextureType_BASE_COLOR, aiTextureType_DIFFUSE}) {
      if (to.base_color.texture < 0 && from.GetTexture(type, 0, &text) == aiReturn_SUCCESS && text.length > 0)
        to.base_color.texture = textures.get(text.C_Str());
    }
    // A texture replaces the colour in these formats, where glTF multiplies the two.
    aiColor4D color(1.0f, 1.0f, 1.0f, 1.0f);
    const bool has_color = from.Get(AI_MATKEY_BASE_COLOR, color) == aiReturn_SUCCESS ||
                           from.Get(AI_MATKEY_COLOR_DIFFUSE, color) == aiReturn_SUCCESS;
    if (has_color && to.base_color.texture < 0 && is_color(color))
      to.material.base_color = Eigen::Vector4f(color.r, color.g, color.b, 1.0f);
    // Exporters disagree about what 0 means; nobody wants an invisible asset.
    float opacity = 1.0f;
    if (from.Get(AI_MATKEY_OPACITY, opacity) == aiReturn_SUCCESS && opacity > 0.0f && opacity <= 1.0f)
      to.material.base_color.w() = opacity;
    document.materials.push_back(std::move(to));
  }
}

}  // namespace anigen::io::assimp_import
