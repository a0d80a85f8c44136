#include "anigen/io/rigs/scene_shape.h"

#include <utility>

#include "anigen/io/gltf.h"
#include "anigen/io/rigs/assimp_scene.h"
#include "anigen/io/rigs/file_list.h"
#include "anigen/io/rigs/shape_parts.h"

namespace anigen::io {

RiggedShape read_scene_shape(const std::filesystem::path& file, const std::string& id, Axes axes, bool require_rig) {
  const std::string extension = lower_extension(file);
  const bool is_gltf = extension == ".glb" || extension == ".gltf";
  ImportOptions options;
  options.require_rig = require_rig;
  ImportedAsset imported = is_gltf ? read_gltf(file, options) : read_assimp(file, options);
  RiggedShape shape = rigged_shape(std::move(imported.asset), id, file.string());
  shape.lowest_weight_sum = imported.lowest_weight_sum;
  if (shape.has_joints()) check(shape.joints, shape.file);
  for (const ImportNote& note : imported.notes) shape.notes.push_back(note.code + ": " + note.message);
  if (axes == Axes::kZUp) to_y_up(shape);
  note_missing_parts(shape);
  return shape;
}

}  // namespace anigen::io
