#include "anigen/io/gltf/import_parse.h"

#include <set>

namespace anigen::io::gltf_import {
namespace {

void check_version(const JsonPlace& root) {
  const JsonPlace asset = root.at("asset");
  const std::string version = asset.at("version").string();
  if (version.rfind("2.", 0) != 0) asset.not_supported("glTF version '" + version.substr(0, 20) + "'");
  const std::string minimum = asset.string_or("minVersion", "2.0");
  if (minimum != "2.0") asset.not_supported("glTF minVersion '" + minimum.substr(0, 20) + "'");
}

// Extensions that a file may require and that we read, or that change nothing we keep (shading, lights).
bool is_supported(const std::string& extension) {
  static const std::set<std::string> read = {"KHR_draco_mesh_compression", "EXT_meshopt_compression",
                                             "KHR_mesh_quantization", "KHR_texture_transform", "KHR_lights_punctual"};
  return read.count(extension) != 0 || extension.rfind("KHR_materials_", 0) == 0;
}

}  // namespace

Document parse_document(const Container& container, const ImportOptions& options, Notes& notes) {
  Document document;
  document.file = container.file;
  const JsonPlace root(container.json, container.file);
  check_version(root);
  if (const auto required = root.find("extensionsRequired")) {
    for (std::size_t i = 0; i < required->size(); ++i) {
      const std::string extension = (*required)[i].string();
      if (!is_supported(extension)) (*required)[i].not_supported("extension " + extension.substr(0, 80));
    }
  }
  parse_buffers(root, container, options, document, notes);
  parse_accessors(root, options, document);
  parse_materials(root, document, notes);
  parse_meshes(root, document);
  parse_nodes(root, options, document, notes);
  parse_skins(root, document);
  parse_animations(root, document, notes);
  return document;
}

}  // namespace anigen::io::gltf_import
