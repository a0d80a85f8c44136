#include "anigen/io/rigs/anymate_sample.h"

#include <utility>

#include "anigen/io/rigs/anymate_skeleton.h"
#include "anigen/io/rigs/array_fields.h"
#include "anigen/io/rigs/shape_parts.h"
#include "anigen/io/rigs/skin_rows.h"

namespace anigen::io {
namespace {

/// Weights per bone as pairs of index and weight, or dense, given to the joints at the bones' heads.
class BoneSkin {
 public:
  BoneSkin(const ArrayFields& fields, const std::vector<int>& heads, RiggedShape& shape)
      : fields_(fields),
        heads_(heads),
        shape_(shape),
        rows_(shape.mesh.vertices.size(), shape.joints.size(), fields.file()) {}

  void read(const std::string& name) {
    const std::string index = name + "_index", weight = name + "_weight";
    if (fields_.has(index))
      read_pairs(index, weight);
    else if (fields_.has(name))
      read_dense(name);
    else
      return;
    set_skin(shape_, rows_, first_root(shape_.joints));
  }

 private:
  std::int64_t vertices() const { return static_cast<std::int64_t>(shape_.mesh.vertices.size()); }

  void read_pairs(const std::string& index, const std::string& weight) {
    const std::vector<std::int32_t> bones = fields_.integers(index, {vertices(), -1});
    const std::int64_t width = fields_.array(index, {vertices(), -1}).shape[1];
    const std::vector<float> weights = fields_.reals(weight, {vertices(), width});
    for (std::size_t i = 0; i < bones.size(); ++i) {
      if (bones[i] != -1) add(static_cast<std::int64_t>(i) / width, bones[i], weights[i], index);
    }
  }

  void read_dense(const std::string& name) {
    const std::vector<float> weights = fields_.reals(name, {vertices(), -1});
    const std::int64_t width = fields_.array(name, {vertices(), -1}).shape[1];
    for (std::size_t i = 0; i < weights.size(); ++i) {
      const auto bone = static_cast<std::int32_t>(static_cast<std::int64_t>(i) % width);
      if (weights[i] != 0.0f) add(static_cast<std::int64_t>(i) / width, bone, weights[i], name);
    }
  }

  void add(std::int64_t vertex, std::int32_t bone, float weight, const std::string& name) {
    const std::string place = name + "[" + std::to_string(vertex) + "]";
    if (bone < 0 || static_cast<std::size_t>(bone) >= heads_.size())
      fields_.fail(place, "names bone " + std::to_string(bone) + " of " + std::to_string(heads_.size()));
    rows_.add(vertex, heads_[static_cast<std::size_t>(bone)], weight, place);
  }

  const ArrayFields& fields_;
  const std::vector<int>& heads_;
  RiggedShape& shape_;
  SkinRows rows_;
};

}  // namespace

RiggedShape shape_from_anymate(const NamedArrays& sample, const std::string& id, const std::string& file) {
  const ArrayFields fields(sample, file);
  RiggedShape shape;
  shape.id = id;
  shape.file = file;
  const bool whole_mesh = fields.has("mesh_pc") && fields.has("mesh_face");
  const std::string points = whole_mesh ? "mesh_pc" : fields.first_of({"pc", "mesh_pc"});
  if (!points.empty()) {
    shape.mesh.vertices = fields.points(points);
    if (whole_mesh) shape.mesh.faces = fields.triangles("mesh_face", shape.mesh.vertices.size());
    set_normals(shape, fields.unchecked_points(points, 3));
  }
  AnymateSkeleton skeleton = read_anymate_skeleton(fields);
  if (fields.has("joints") || fields.has("bones")) {
    check(skeleton.joints, file);
    shape.joints = std::move(skeleton.joints);
    if (!points.empty()) BoneSkin(fields, skeleton.bone_head, shape).read(points == "mesh_pc" ? "mesh_skins" : "skins");
  }
  note_missing_parts(shape);
  return shape;
}

}  // namespace anigen::io
