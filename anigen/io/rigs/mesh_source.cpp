#include <algorithm>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/obj.h"
#include "anigen/io/ply.h"
#include "anigen/io/rigs/file_list.h"
#include "anigen/io/rigs/shape_source.h"
#include "anigen/io/rigs/text_rig.h"
#include "anigen/io/stl.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;

const std::vector<std::string> kMeshExtensions = {".obj", ".ply", ".stl"};
const std::vector<std::string> kRiggedExtensions = {".glb", ".gltf", ".fbx", ".dae", ".npz", ".pt", ".pth"};

bool is_mesh_file(const fs::path& file) {
  const std::string extension = lower_extension(file);
  return std::find(kMeshExtensions.begin(), kMeshExtensions.end(), extension) != kMeshExtensions.end();
}

RiggedShape read_mesh_shape(const fs::path& file, const std::string& id, Axes axes) {
  require_content(file);
  RiggedShape shape;
  shape.id = id;
  shape.file = file.string();
  const std::string extension = lower_extension(file);
  const bool obj = extension == ".obj";
  shape.mesh = obj ? read_obj(file) : extension == ".ply" ? read_ply(file) : read_stl(file);
  turn_to_z_up(shape, axes, obj ? Axes::kYUp : Axes::kZUp);
  return shape;
}

bool holds_rigs(const fs::path& folder) {
  if (fs::exists(folder / "metadata.csv") || !files_below(folder, kRiggedExtensions).empty()) return true;
  for (const fs::path& file : files_below(folder, {".txt"})) {
    if (is_text_rig(file)) return true;
  }
  return false;
}

}  // namespace

std::unique_ptr<ShapeSource> open_meshes(const fs::path& path, const SourceOptions& wanted) {
  SourceOptions options = wanted;
  options.require_rig = false;
  std::error_code error;
  const bool folder = fs::is_directory(path, error);
  if (folder ? holds_rigs(path) : !is_mesh_file(path)) return open_source(path, options);
  const Axes axes = options.axes;
  const auto reader = [axes](const fs::path& file, const std::string& id) { return read_mesh_shape(file, id, axes); };
  if (!folder) {
    std::vector<FileListSource::Entry> entries = {{path.stem().string(), path}};
    return std::make_unique<FileListSource>(std::move(entries), reader, "mesh " + path.string(), true);
  }
  const std::vector<fs::path> files = files_below(path, kMeshExtensions);
  if (files.empty()) return open_source(path, options);  // which says what it looked for
  return std::make_unique<FileListSource>(entries_below(path, files), reader,
                                          std::to_string(files.size()) + " meshes in " + path.string(), false);
}

}  // namespace anigen::io
