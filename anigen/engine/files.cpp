#include "anigen/engine/files.h"

#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/private_folder.h"
#include "anigen/engine/module.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/rigs/read_assimp.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/io/write_rigged.h"

namespace anigen::engine {

namespace {

namespace fs = std::filesystem;

const std::vector<std::string> kGltf = {".glb", ".gltf"};
const std::vector<std::string> kScenes = {".fbx", ".dae"};

io::ImportOptions mesh_alone_allowed() {
  io::ImportOptions options;
  options.require_rig = false;
  return options;
}

/// The one shape of a format without rigs.
Asset load_shape(const fs::path& file) {
  const auto source = io::open_meshes(file, {io::Axes::kFormat, false});
  const std::vector<std::string> ids = source->ids();
  if (ids.size() != 1) throw InputError(file.string(), "", "holds " + std::to_string(ids.size()) + " assets, not one");
  const io::RiggedShape shape = source->read(ids.front());
  Asset asset;
  if (shape.has_joints()) {
    asset = io::to_asset(shape);
  } else {
    asset.mesh = shape.mesh;
    asset.materials = shape.materials;
    asset.images = shape.images;
  }
  asset.name = file.stem().string();
  return asset;
}

io::ExportOptions export_options(const Asset& asset) {
  io::ExportOptions options;
  options.require_rig = false;
  options.influences = std::max<std::size_t>(options.influences, asset.skin.largest_row());
  return options;
}

}  // namespace

Asset load(const fs::path& file) {
  quiet_log();
  if (io::has_extension(file, kGltf)) return io::read_gltf(file, mesh_alone_allowed()).asset;
  if (io::has_extension(file, kScenes)) {
    io::require_content(file);
    return io::read_assimp(file, mesh_alone_allowed()).asset;
  }
  return load_shape(file);
}

Asset load_bytes(const std::string& bytes, const std::string& name) {
  quiet_log();
  const fs::path called = fs::path(name).filename();
  if (io::has_extension(called, kGltf)) return io::read_gltf_bytes(bytes, name, mesh_alone_allowed()).asset;
  if (called.stem().empty() || !called.has_extension())
    throw InputError(name, "", "the extension of its format is missing");
  const PrivateFolder folder;
  write_file_atomically(folder / called.string(), bytes);
  try {
    return load(folder / called.string());
  } catch (const NotSupportedError&) {
    throw;
  } catch (const InputError& error) {
    throw InputError(name, error.place(), error.problem());
  }
}

void save(const Asset& asset, const fs::path& file) { io::write_rigged(file, asset, export_options(asset)); }

std::string save_bytes(const Asset& asset, const std::string& format) {
  if (format == "glb" || format == "gltf")
    return io::gltf_bytes(asset.name, asset, format == "glb", export_options(asset));
  if (format != "fbx" && format != "usdz")
    throw InputError("", "format", "\"" + format + "\" is none of glb, gltf, fbx, usdz");
  const PrivateFolder folder;
  const fs::path file = folder / ("asset." + format);
  save(asset, file);
  return read_file(file);
}

}  // namespace anigen::engine
