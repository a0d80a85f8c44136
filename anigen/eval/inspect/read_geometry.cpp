#include <algorithm>
#include <cstdio>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/eval/inspect/inspect.h"
#include "anigen/io/rigs/assimp_scene.h"
#include "anigen/io/rigs/bvh.h"
#include "anigen/io/rigs/file_list.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/io/rigs/shape_source.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

/// The code of notes that readers of shapes write as sentences.
constexpr const char* kPlainNote = "note";

std::string metres(double unit) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g m", unit);
  return text;
}

Geometry scene(const fs::path& file) {
  io::require_content(file);
  const std::string extension = io::lower_extension(file);
  const bool is_gltf = extension == ".glb" || extension == ".gltf";
  io::ImportOptions options;
  options.require_rig = false;
  Geometry geometry;
  geometry.imported = is_gltf ? io::read_gltf(file, options) : io::read_assimp(file, options);
  const io::FileFrame& frame = geometry.imported.frame;
  geometry.source = {{"format", is_gltf               ? "glTF"
                                : extension == ".fbx" ? "FBX"
                                                      : "COLLADA"},
                     {"axes", std::string(1, frame.up) + " up"},
                     {"unit", metres(frame.metres)}};
  return geometry;
}

/// Kind of a file that has no rule of its own.
std::string by_custom(char up) { return std::string(1, up) + " up by custom; the file does not say"; }

/// A shape's parts as far as it has them; its notes keep their sentences, under the codes that importers gave them.
io::ImportedAsset imported(io::RiggedShape shape) {
  io::ImportedAsset result;
  if (shape.has_joints()) {
    const std::size_t trees = io::roots(shape.joints).size();
    result.asset = io::to_asset(shape);
    if (trees > 1)
      result.notes.push_back(
          {"several_roots", std::to_string(trees) + " joint roots: all but the first became its children"});
  } else {
    result.asset.name = shape.id;
    result.asset.mesh = std::move(shape.mesh);
    result.asset.materials = std::move(shape.materials);
    result.asset.images = std::move(shape.images);
  }
  for (const std::string& note : shape.notes) {
    // "a forest of" tells of several_roots again; missing parts stand under `rig`.
    if (note.rfind("no ", 0) == 0 || note.rfind("a forest of ", 0) == 0) continue;
    result.notes.push_back({kPlainNote, note});
  }
  result.lowest_weight_sum = shape.lowest_weight_sum;
  return result;
}

/// @param id of the sample; empty for a file that is one shape
Geometry shape(const fs::path& file, const std::string& id, FileKind kind) {
  const auto source = io::open_meshes(file);
  const std::string wanted = id.empty() ? source->ids().front() : id;
  Geometry geometry;
  geometry.imported = imported(source->read(wanted));
  const std::string extension = io::lower_extension(file);
  if (kind == FileKind::kMesh) {
    const bool obj = extension == ".obj";
    const std::string name = obj ? "OBJ" : extension == ".ply" ? "PLY" : "STL";
    geometry.source = {{"format", name}, {"axes", by_custom(obj ? 'Y' : 'Z')}};
    if (obj) geometry.source["left_out"] = "materials and textures of the .mtl";
  } else if (kind == FileKind::kTextRig) {
    geometry.source = {{"format", "text rig"}, {"axes", by_custom('Y')}};
  } else if (kind == FileKind::kRigNpz) {
    geometry.source = {{"format", "arrays of a rig"}, {"axes", by_custom('Z')}};
  } else {
    geometry.source = {{"format", source->describe()}};
  }
  geometry.source["unit"] = "not said";
  return geometry;
}

Geometry motion(const fs::path& file) {
  io::require_content(file);
  io::BvhMotion read = io::read_bvh(file);
  Geometry geometry;
  geometry.source = {{"format", "BVH"},
                     {"axes", by_custom('Y')},
                     {"unit", "not said"},
                     {"frames", read.frames},
                     {"frames_per_second", 1.0 / read.frame_time}};
  Asset& asset = geometry.imported.asset;
  asset.name = file.stem().string();
  asset.skeleton = std::move(read.skeleton);
  asset.animations.push_back(std::move(read.animation));
  return geometry;
}

}  // namespace

Geometry read_geometry(const fs::path& path, FileKind kind) {
  switch (kind) {
    case FileKind::kScene:
      return scene(path);
    case FileKind::kMotion:
      return motion(path);
    case FileKind::kMesh:
    case FileKind::kTextRig:
    case FileKind::kRigNpz:
      return shape(path, "", kind);
    case FileKind::kSample:
      if (const auto sample = sample_of(path)) return shape(sample->first, sample->second, kind);
      break;
    default:
      break;
  }
  throw InputError(path.string(), "", "holds no mesh and no skeleton");
}

}  // namespace anigen::eval
