#include "anigen/eval/inputs/gltf_shape.h"

#include <utility>

#include "anigen/eval/inputs/shape_parts.h"
#include "anigen/io/gltf.h"

namespace anigen::eval {

RiggedShape read_gltf_shape(const std::filesystem::path& file, const std::string& id, Axes axes) {
  io::ImportedAsset imported = io::read_gltf(file);
  RiggedShape shape = rigged_shape(std::move(imported.asset), id, file.string());
  check(shape.joints, shape.file);
  for (const io::ImportNote& note : imported.notes) shape.notes.push_back(note.code + ": " + note.message);
  if (axes == Axes::kZUp) to_y_up(shape);
  note_missing_parts(shape);
  return shape;
}

}  // namespace anigen::eval
