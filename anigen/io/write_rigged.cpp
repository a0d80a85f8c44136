#include "anigen/io/write_rigged.h"

#include "anigen/core/error.h"
#include "anigen/io/fbx/export.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/usd/export.h"

namespace anigen::io {

std::vector<std::string> rigged_format_words() { return {"glb", "gltf", "fbx", "usdz", "usda"}; }

bool is_rigged_output(const std::filesystem::path& file) {
  return has_extension(file, {".glb", ".gltf", ".fbx", ".usda", ".usdz"});
}

void write_rigged(const std::filesystem::path& file, const Asset& asset, const ExportOptions& options) {
  if (!is_rigged_output(file))
    throw InputError(file.string(), "", "a rigged asset is written as .glb, .gltf, .fbx, .usda or .usdz");
  if (has_extension(file, {".fbx"})) return write_fbx(file, asset, options);
  if (has_extension(file, {".usda", ".usdz"})) return write_usd(file, asset, options);
  write_gltf(file, asset, options);
}

}  // namespace anigen::io
