#include "anigen/io/rigs/rig_arrays.h"

#include <algorithm>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/arrays/npz.h"

namespace anigen::io {

RiggedShape shape_from_rig_arrays(const NamedArrays& arrays, const std::string& id, const std::string& file) {
  const ArrayFields fields(arrays, file);
  RiggedShape shape = shape_with_mesh(fields, "vertex_normals", id, file);
  if (fields.has("joints")) {
    shape.joints.positions = fields.points<Eigen::Vector3d>("joints");
    shape.joints.parents = fields.integers("parents", {fields.rows("joints")});
    anigen::check(shape.joints, file);
    if (fields.has("skin")) set_dense_skin(fields, "skin", shape);
  }
  note_missing_parts(shape);
  return shape;
}

RiggedShape read_rig_npz(const std::filesystem::path& file, const std::string& id) {
  std::vector<std::string> present;
  bool has_names = false;
  {
    const ZipReader archive(file);
    for (const char* name : {"joints", "parents", "skin", "vertices", "faces", "vertex_normals"}) {
      if (archive.find(std::string(name) + ".npy") != nullptr) present.emplace_back(name);
    }
    has_names = archive.find("names.npy") != nullptr;
  }
  if (present.empty())
    throw InputError(file.string(), "",
                     "has none of the arrays joints, parents, skin, vertices; where it holds a list of samples, name "
                     "the file itself instead of its folder");
  RiggedShape shape = shape_from_rig_arrays(read_npz(file, present), id, file.string());
  if (!has_names) return shape;
  const NpzValue names = read_npz_objects(file, {"names"}).front().second;
  const bool texts = std::all_of(names.items.begin(), names.items.end(),
                                 [](const NpzValue& name) { return name.kind == NpzValue::Kind::kString; });
  if (!texts || names.items.size() != shape.joints.size()) {
    shape.notes.push_back("its names do not fit its joints and were left out");
    return shape;
  }
  for (const NpzValue& name : names.items) shape.joint_names.push_back(name.text);
  return shape;
}

bool is_rig_npz(const std::filesystem::path& file) {
  const ZipReader archive(file);
  return archive.find("joints.npy") != nullptr || archive.find("vertices.npy") != nullptr;
}

}  // namespace anigen::io
