#include "anigen/eval/inputs/rig_arrays.h"

#include <algorithm>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/eval/inputs/array_fields.h"
#include "anigen/eval/inputs/shape_parts.h"
#include "anigen/io/arrays/zip_archive.h"
#include "anigen/io/npz.h"

namespace anigen::eval {

RiggedShape shape_from_rig_arrays(const io::NamedArrays& arrays, const std::string& id, const std::string& file) {
  const ArrayFields fields(arrays, file);
  RiggedShape shape = shape_with_mesh(fields, "vertex_normals", id, file);
  if (fields.has("joints")) {
    shape.joints.positions = fields.precise_points("joints");
    shape.joints.parents = fields.integers("parents", {fields.rows("joints")});
    check(shape.joints, file);
    if (fields.has("skin")) shape.skin = dense_skin(fields, "skin", shape);
  }
  note_missing_parts(shape);
  return shape;
}

RiggedShape read_rig_npz(const std::filesystem::path& file, const std::string& id) {
  std::vector<std::string> present;
  bool has_names = false;
  {
    const io::ZipReader archive(file);
    for (const char* name : {"joints", "parents", "skin", "vertices", "faces", "vertex_normals"}) {
      if (archive.find(std::string(name) + ".npy") != nullptr) present.emplace_back(name);
    }
    has_names = archive.find("names.npy") != nullptr;
  }
  if (present.empty())
    throw InputError(file.string(), "",
                     "has none of the arrays joints, parents, skin, vertices; where it holds a list of samples, name "
                     "the file itself instead of its folder");
  RiggedShape shape = shape_from_rig_arrays(io::read_npz(file, present), id, file.string());
  if (!has_names) return shape;
  const io::NpzValue names = io::read_npz_objects(file, {"names"}).front().second;
  const bool texts = std::all_of(names.items.begin(), names.items.end(),
                                 [](const io::NpzValue& name) { return name.kind == io::NpzValue::Kind::kString; });
  if (!texts || names.items.size() != shape.joints.size()) {
    shape.notes.push_back("its names do not fit its joints and were left out");
    return shape;
  }
  for (const io::NpzValue& name : names.items) shape.joint_names.push_back(name.text);
  return shape;
}

bool is_rig_npz(const std::filesystem::path& file) {
  const io::ZipReader archive(file);
  return archive.find("joints.npy") != nullptr || archive.find("vertices.npy") != nullptr;
}

}  // namespace anigen::eval
