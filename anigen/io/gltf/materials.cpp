#include "anigen/io/gltf/materials.h"

#include <algorithm>
#include <set>

#include "anigen/core/error.h"
#include "anigen/io/gltf/container.h"

namespace anigen::io::gltf_import {

namespace {

const char* mime_type_of(std::string_view bytes) {
  if (bytes.substr(0, 8) == "\x89PNG\r\n\x1a\n") return "image/png";
  if (bytes.substr(0, 3) == "\xFF\xD8\xFF") return "image/jpeg";
  return nullptr;
}

class ImageReader {
 public:
  ImageReader(const Document& document, const std::filesystem::path& folder, const ImportOptions& options, Notes& notes)
      : document_(document),
        folder_(folder),
        notes_(notes),
        left_(options.max_file_bytes),
        index_(document.images.size(), kUnread) {}

  // @return index into images(), or -1
  int get(int image) {
    int& index = index_[static_cast<std::size_t>(image)];
    if (index == kUnread) index = read(document_.images[static_cast<std::size_t>(image)]);
    return index;
  }
  std::vector<EncodedImage> take() { return std::move(images_); }

 private:
  static constexpr int kUnread = -2;

  // Empty when there is no such picture. Every read counts, since many entries can name one large file.
  std::string bytes_of(const ImageEntry& entry) {
    if (entry.view >= 0) {
      const std::string_view bytes = document_.views[static_cast<std::size_t>(entry.view)].bytes;
      take(bytes.size(), entry);
      return std::string(bytes);
    }
    if (entry.uri.empty()) return {};
    if (entry.uri.rfind("data:", 0) != 0) {
      const auto path = path_of_uri(entry.uri, folder_, document_.file, entry.pointer + "/uri");
      std::error_code error;
      if (!std::filesystem::exists(path, error)) return {};
    }
    std::string bytes = read_uri(entry.uri, folder_, document_.file, entry.pointer + "/uri", left_).bytes;
    take(bytes.size(), entry);
    return bytes;
  }

  void take(std::size_t bytes, const ImageEntry& entry) {
    if (bytes > left_) throw InputError(document_.file, entry.pointer, "the images exceed the importer's limit");
    left_ -= bytes;
  }

  int read(const ImageEntry& entry) {
    EncodedImage image;
    const std::string bytes = bytes_of(entry);
    if (bytes.empty()) {
      notes_.add("missing_image", "image '" + (entry.uri.empty() ? entry.name : entry.uri).substr(0, 80) +
                                      "' is not there: its material has no texture");
      return -1;
    }
    const char* mime_type = mime_type_of(bytes);
    if (mime_type == nullptr) {
      notes_.add("unsupported_image", "image '" + (entry.name.empty() ? entry.pointer : entry.name).substr(0, 80) +
                                          "' is neither PNG nor JPEG: its material has no texture");
      return -1;
    }
    image.mime_type = mime_type;
    image.name = entry.name;
    if (image.name.empty() && entry.view < 0 && entry.uri.rfind("data:", 0) != 0)
      image.name = std::filesystem::path(entry.uri).stem().string();
    image.bytes.assign(bytes.begin(), bytes.end());
    images_.push_back(std::move(image));
    return static_cast<int>(images_.size()) - 1;
  }

  const Document& document_;
  const std::filesystem::path& folder_;
  Notes& notes_;
  std::uintmax_t left_;
  std::vector<int> index_;
  std::vector<EncodedImage> images_;
};

}  // namespace

MaterialSet read_materials(const Document& document, const std::filesystem::path& folder, const ImportOptions& options,
                           Notes& notes) {
  // Refused even where no material uses them, so that a file is either sound or not.
  for (const ImageEntry& image : document.images) {
    if (!image.uri.empty() && image.uri.rfind("data:", 0) != 0)
      path_of_uri(image.uri, folder, document.file, image.pointer + "/uri");
  }
  ImageReader reader(document, folder, options, notes);
  MaterialSet result;
  for (const MaterialEntry& entry : document.materials) {
    Material material = entry.material;
    const int texture = entry.base_color.texture;
    const int image = texture >= 0 ? document.texture_images[static_cast<std::size_t>(texture)] : -1;
    if (image >= 0) material.image = reader.get(image);
    result.materials.push_back(std::move(material));
  }
  result.images = reader.take();
  return result;
}

}  // namespace anigen::io::gltf_import

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
