#include <cmath>

#include "anigen/io/gltf/import_parse.h"

namespace anigen::io::gltf_import {
namespace {

Transform parse_trs(const JsonPlace& place, Notes& notes) {
  Transform local;
  if (const auto translation = place.find("translation")) {
    const std::vector<double> t = translation->numbers(3);
    local.translation = {t[0], t[1], t[2]};
  }
  if (const auto rotation = place.find("rotation")) {
    const std::vector<double> q = rotation->numbers(4);
    local.rotation = Eigen::Quaterniond(q[3], q[0], q[1], q[2]);
    const double norm = local.rotation.norm();
    if (!(norm > 1e-9) || !std::isfinite(norm)) rotation->fail("the rotation is not a quaternion of unit length");
    if (std::abs(norm - 1.0) > 1e-3)
      notes.tally("unnormalised_rotation", "node rotations were not of unit length and were normalised");
    local.rotation.coeffs() /= norm;
  }
  if (const auto scale = place.find("scale")) {
    const std::vector<double> s = scale->numbers(3);
    local.scale = {s[0], s[1], s[2]};
  }
  return local;
}

void parse_transform(const JsonPlace& place, Node& node, Notes& notes) {
  const auto matrix = place.find("matrix");
  if (!matrix) {
    node.local = parse_trs(place, notes);
    node.matrix = node.local.matrix();
  } else {
    const std::vector<double> m = matrix->numbers(16);
    node.matrix = Eigen::Map<const Eigen::Matrix4d>(m.data());
    // Exporters write float noise here; anything more is a projection, which glTF does not allow.
    if ((node.matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 1e-3)
      matrix->fail("the last row of a node's matrix must be 0 0 0 1");
    node.matrix.row(3) = Eigen::RowVector4d(0, 0, 0, 1);
    node.local = decompose(node.matrix, &node.shear);
  }
  const Transform& local = node.local;
  if (!node.matrix.allFinite() || !local.translation.allFinite() || !local.rotation.coeffs().allFinite() ||
      !local.scale.allFinite() || !std::isfinite(node.matrix.squaredNorm())) {
    place.fail("the node's transform is not finite");
  }
}

// Gives every node its parent, refusing a second one: with the check for cycles that makes the graph a forest.
void link(const JsonPlace& list, std::vector<Node>& nodes) {
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const auto children = list[i].find("children");
    for (std::size_t k = 0; children && k < children->size(); ++k) {
      const int child = (*children)[k].as_index(nodes.size(), "node");
      Node& node = nodes[static_cast<std::size_t>(child)];
      if (node.parent >= 0) {
        (*children)[k].fail("node " + std::to_string(child) + " already is a child of node " +
                            std::to_string(node.parent));
      }
      node.parent = static_cast<int>(i);
      nodes[i].children.push_back(child);
    }
  }
}

// Breadth first from the roots; nodes of a cycle are never reached.
std::vector<int> top_down_order(const JsonPlace& list, const std::vector<Node>& nodes) {
  std::vector<int> order;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (nodes[i].parent < 0) order.push_back(static_cast<int>(i));
  }
  for (std::size_t k = 0; k < order.size(); ++k) {
    for (const int child : nodes[static_cast<std::size_t>(order[k])].children) order.push_back(child);
  }
  if (order.size() == nodes.size()) return order;
  std::vector<char> reached(nodes.size(), 0);
  for (const int node : order) reached[static_cast<std::size_t>(node)] = 1;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (reached[i] == 0) list[i].fail("node " + std::to_string(i) + " is its own ancestor: the node graph has a cycle");
  }
  return order;
}

void mark_scene(const JsonPlace& root, const ImportOptions& options, Document& document) {
  const std::size_t scenes = root.size_of("scenes");
  int scene = root.index_or_none("scene", scenes, "scene");
  if (options.scene >= 0) {
    if (static_cast<std::size_t>(options.scene) >= scenes) {
      root.fail("scene " + std::to_string(options.scene) + " was asked for, the file has " + std::to_string(scenes));
    }
    scene = options.scene;
  }
  if (scene < 0 && scenes > 0) scene = 0;
  document.in_scene.assign(document.nodes.size(), scene < 0 ? 1 : 0);
  if (scene < 0) return;  // a file without scenes: everything is shown
  const auto list = root.at("scenes")[static_cast<std::size_t>(scene)].find("nodes");
  for (std::size_t i = 0; list && i < list->size(); ++i)
    document.in_scene[static_cast<std::size_t>((*list)[i].as_index(document.nodes.size(), "node"))] = 1;
  for (const int n : document.top_down) {
    const int parent = document.nodes[static_cast<std::size_t>(n)].parent;
    if (parent >= 0 && document.in_scene[static_cast<std::size_t>(parent)] != 0)
      document.in_scene[static_cast<std::size_t>(n)] = 1;
  }
}

}  // namespace

void parse_nodes(const JsonPlace& root, const ImportOptions& options, Document& document, Notes& notes) {
  const std::size_t meshes = root.size_of("meshes"), skins = root.size_of("skins");
  if (const auto list = root.find("nodes")) {
    if (list->size() > options.max_nodes) {
      list->fail(std::to_string(list->size()) + " nodes exceed the limit of " + std::to_string(options.max_nodes));
    }
    for (std::size_t i = 0; i < list->size(); ++i) {
      const JsonPlace place = (*list)[i];
      Node node;
      node.name = place.string_or("name", "");
      node.mesh = place.index_or_none("mesh", meshes, "mesh");
      node.skin = place.index_or_none("skin", skins, "skin");
      parse_transform(place, node, notes);
      document.nodes.push_back(std::move(node));
    }
    link(*list, document.nodes);
    document.top_down = top_down_order(*list, document.nodes);
  }
  mark_scene(root, options, document);
}

void parse_skins(const JsonPlace& root, Document& document) {
  const auto list = root.find("skins");
  for (std::size_t i = 0; list && i < list->size(); ++i) {
    const JsonPlace place = (*list)[i];
    Skin skin;
    skin.pointer = place.pointer();
    const JsonPlace joints = place.at("joints");
    if (joints.size() == 0) joints.fail("the skin has no joints");
    if (joints.size() > document.nodes.size()) joints.fail("the skin lists more joints than the file has nodes");
    std::vector<char> listed(document.nodes.size(), 0);
    for (std::size_t k = 0; k < joints.size(); ++k) {
      const int joint = joints[k].as_index(document.nodes.size(), "node");
      if (listed[static_cast<std::size_t>(joint)]++ != 0)
        joints[k].fail("node " + std::to_string(joint) + " is listed twice");
      skin.joints.push_back(joint);
    }
    place.index_or_none("skeleton", document.nodes.size(), "node");
    skin.inverse_bind_accessor = place.index_or_none("inverseBindMatrices", document.accessors.size(), "accessor");
    if (skin.inverse_bind_accessor >= 0) {
      const Accessor& accessor = document.accessors[static_cast<std::size_t>(skin.inverse_bind_accessor)];
      const JsonPlace where = place.at("inverseBindMatrices");
      if (accessor.type != "MAT4" || accessor.component != Component::kF32)
        where.fail("inverse bind matrices must be 32-bit float MAT4");
      if (accessor.count < skin.joints.size()) {
        where.fail("there are " + std::to_string(accessor.count) + " inverse bind matrices for " +
                   std::to_string(skin.joints.size()) + " joints");
      }
    }
    document.skins.push_back(std::move(skin));
  }
}

}  // namespace anigen::io::gltf_import
