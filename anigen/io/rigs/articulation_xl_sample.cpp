#include <algorithm>
#include <cstdint>

#include "anigen/core/error.h"
#include "anigen/io/arrays/npz_objects.h"
#include "anigen/io/rigs/array_fields.h"
#include "anigen/io/rigs/articulation_xl.h"
#include "anigen/io/rigs/content_id.h"
#include "anigen/io/rigs/shape_parts.h"
#include "anigen/io/rigs/skin_rows.h"

namespace anigen::io {
namespace {

/// The dictionary's numbers under their keys; lists of numbers count as arrays.
NamedArrays numeric_items(const NpzValue& sample, const std::string& file) {
  NamedArrays arrays;
  for (std::size_t i = 0; i < sample.items.size(); ++i) {
    const std::string& key = sample.keys[i];
    if (key == "pc_w_norm" || key == "uuid" || key == "joint_names") continue;
    if (sample.items[i].kind == NpzValue::Kind::kNone || sample.items[i].kind == NpzValue::Kind::kString) continue;
    append_numeric_leaves(sample.items[i], key, {file, key}, arrays);
  }
  return arrays;
}

std::vector<int> parents_from_bones(const ArrayFields& fields, std::size_t joints) {
  std::vector<int> parents(joints, -1);
  if (!fields.has("bones") || fields.rows("bones") == 0) return parents;
  const std::vector<std::int32_t> ends = fields.integers("bones", {-1, 2});
  for (std::size_t b = 0; b < ends.size() / 2; ++b) {
    const std::int32_t parent = ends[2 * b], child = ends[2 * b + 1];
    const std::string place = "bones[" + std::to_string(b) + "]";
    for (const std::int32_t end : {parent, child}) {
      if (end < 0 || static_cast<std::size_t>(end) >= joints)
        fields.fail(place, "names joint " + std::to_string(end) + " of " + std::to_string(joints));
    }
    int& known = parents[static_cast<std::size_t>(child)];
    if (known >= 0 && known != parent)
      fields.fail(place, "joint " + std::to_string(child) + " already has the parent " + std::to_string(known));
    known = parent;
  }
  return parents;
}

/// Released files say `…_row`, the published writer `…_rows`.
std::string index_key(const ArrayFields& fields, const std::string& name) {
  const std::string found = fields.first_of({name, name + "s"});
  if (found.empty()) fields.fail(name, "the array is missing");
  return found;
}

void read_skin(const ArrayFields& fields, RiggedShape& shape) {
  const std::string value = "skinning_weights_value", sizes = "skinning_weights_shape";
  if (!fields.has(value)) return;
  const auto vertices = static_cast<std::int64_t>(shape.mesh.vertices.size());
  const auto joints = static_cast<std::int64_t>(shape.joints.size());
  if (fields.has(sizes)) {
    const std::vector<std::int32_t> told = fields.integers(sizes, {2});
    if (told[0] != vertices || told[1] != joints) {
      fields.fail(sizes, "weights for " + std::to_string(told[0]) + " vertices and " + std::to_string(told[1]) +
                             " joints, but there are " + std::to_string(vertices) + " and " + std::to_string(joints));
    }
  }
  const std::int64_t count = fields.rows(value);
  const std::string row_key = index_key(fields, "skinning_weights_row");
  const std::string column_key = index_key(fields, "skinning_weights_col");
  const std::vector<float> weights = fields.reals(value, {count});
  const std::vector<std::int32_t> rows = fields.integers(row_key, {count});
  const std::vector<std::int32_t> columns = fields.integers(column_key, {count});
  SkinRows skin(shape.mesh.vertices.size(), shape.joints.size(), fields.file());
  for (std::size_t i = 0; i < weights.size(); ++i)
    skin.add(rows[i], columns[i], weights[i], value + "[" + std::to_string(i) + "]");
  set_skin(shape, skin, first_root(shape.joints));
}

void read_root(const ArrayFields& fields, RiggedShape& shape) {
  if (!fields.has("root_index")) return;
  const std::int32_t root = fields.integer("root_index");
  if (root < 0 || static_cast<std::size_t>(root) >= shape.joints.size())
    fields.fail("root_index", std::to_string(root) + " of " + std::to_string(shape.joints.size()) + " joints");
  if (shape.joints.parents[static_cast<std::size_t>(root)] >= 0)
    shape.notes.push_back("root_index names joint " + std::to_string(root) + ", which its bones give a parent");
}

void read_names(const NpzValue& sample, RiggedShape& shape) {
  const NpzValue* names = sample.find("joint_names");
  if (names == nullptr || names->items.size() != shape.joints.size()) return;
  for (const NpzValue& name : names->items) shape.joint_names.push_back(name.text);
}

}  // namespace

RiggedShape shape_from_articulation_xl(const NpzValue& sample, const std::string& id, const std::string& file,
                                       std::string* content_id) {
  if (sample.kind != NpzValue::Kind::kDict) throw InputError(file, "", "the sample is no dictionary");
  const NamedArrays arrays = numeric_items(sample, file);
  if (content_id != nullptr) *content_id = io::content_id(arrays);
  const ArrayFields fields(arrays, file);
  RiggedShape shape = shape_with_mesh(fields, "normals", id, file);
  if (fields.has("joints")) {
    shape.joints.positions = fields.precise_points("joints");
    shape.joints.parents = parents_from_bones(fields, shape.joints.positions.size());
    check(shape.joints, file);
    read_root(fields, shape);
    read_names(sample, shape);
    read_skin(fields, shape);
  }
  note_missing_parts(shape);
  return shape;
}

}  // namespace anigen::io
