#include "anigen/io/obj_rig.h"

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/io/gltf/export_axes.h"
#include "anigen/io/obj.h"

namespace anigen::io {

void write_obj_rig(const std::filesystem::path& obj, const Asset& asset, ExportAxes axes) {
  if (asset.skin.rows() != asset.mesh.vertices.size()) {
    throw InputError(obj.string(), "", "as many rows of skin weights as vertices are needed");
  }
  const Eigen::Matrix3d rotation = axis_rotation(axes);
  const Eigen::Matrix3f turn = rotation.cast<float>();
  Mesh mesh = asset.mesh;
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex = turn * vertex;
  for (Eigen::Vector3f& normal : mesh.normals) normal = turn * normal;
  Json joints = Json::array(), skin = Json::array();
  const auto positions = asset.skeleton.positions();
  for (std::size_t j = 0; j < positions.size(); ++j) {
    const Eigen::Vector3d place = rotation * positions[j];
    joints.push_back({{"name", asset.skeleton.names[j]},
                      {"parent", asset.skeleton.parents[j]},
                      {"position", {place.x(), place.y(), place.z()}}});
  }
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
    Json row = Json::array();
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i) {
      row.push_back({asset.skin.row(v)[i].joint, asset.skin.row(v)[i].weight});
    }
    skin.push_back(std::move(row));
  }
  write_obj(obj, mesh);
  std::filesystem::path rig = obj;
  rig.replace_extension(".rig.json");
  write_file_atomically(rig, Json{{"joints", std::move(joints)}, {"skin", std::move(skin)}}.dump() + "\n");
}

}  // namespace anigen::io
