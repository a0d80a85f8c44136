#include "anigen/io/gltf/export_nodes.h"

#include <algorithm>

#include "anigen/io/gltf/export_axes.h"

namespace anigen::io {
namespace {

Json joint_node(const std::string& name, const Transform& rest) {
  const Eigen::Vector3d& t = rest.translation;
  const Eigen::Vector3d& s = rest.scale;
  const Eigen::Quaterniond q = rest.rotation.normalized();
  return {{"name", name},
          {"translation", {t.x() + 0.0, t.y() + 0.0, t.z() + 0.0}},
          {"rotation", {q.x() + 0.0, q.y() + 0.0, q.z() + 0.0, q.w() + 0.0}},
          {"scale", {s.x(), s.y(), s.z()}}};
}

std::string unused_name(const std::string& wanted, const std::vector<std::string>& taken) {
  std::string name = wanted;
  for (int i = 1; std::find(taken.begin(), taken.end(), name) != taken.end(); ++i) {
    name = wanted + "_mesh" + (i == 1 ? "" : std::to_string(i));
  }
  return name;
}

}  // namespace

void write_nodes(GltfDocument& document, const Asset& asset, ExportAxes axes) {
  const Skeleton& skeleton = asset.skeleton;
  Json nodes = Json::array();
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    Transform rest = skeleton.rest[j];
    if (skeleton.parents[j] < 0) {
      rest.translation = axis_rotation(axes) * rest.translation;
      rest.rotation = axis_quaternion(axes) * rest.rotation;
    }
    nodes.push_back(joint_node(skeleton.names[j], rest));
  }
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    if (skeleton.parents[j] >= 0) nodes[static_cast<std::size_t>(skeleton.parents[j])]["children"].push_back(j);
  }
  Json roots = Json::array();
  if (skeleton.size() > 0) roots.push_back(0);
  if (!asset.mesh.vertices.empty()) {
    const std::string name = unused_name(asset.name.empty() ? "mesh" : asset.name, skeleton.names);
    roots.push_back(nodes.size());
    nodes.push_back({{"name", name}, {"mesh", 0}});
    if (skeleton.size() > 0) nodes.back()["skin"] = 0;
  }
  document.json["scene"] = 0;
  Json scene = Json::object();
  if (!asset.name.empty()) scene["name"] = asset.name;
  scene["nodes"] = std::move(roots);
  document.json["scenes"] = Json::array({std::move(scene)});
  document.json["nodes"] = std::move(nodes);
}

}  // namespace anigen::io
