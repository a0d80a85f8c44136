#include "anigen/io/rigs/assimp_nodes.h"

#include <Eigen/LU>
#include <cmath>
#include <cstdint>
#include <string_view>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::io::assimp_import {
namespace {

using Eigen::Matrix4d;

/// Assimp splits the transform of an FBX model into a chain of nodes with these names, one child each.
bool is_helper(const aiNode& node) {
  const std::string_view name(node.mName.C_Str());
  return name.find("_$AssimpFbx$_") != std::string_view::npos && node.mNumMeshes == 0 && node.mNumChildren == 1;
}

/// An axis of the file as metadata tell it: number and sign.
Eigen::RowVector3d axis(const aiScene& scene, const char* name, int number, int sign) {
  std::int32_t told = number, told_sign = sign;
  if (scene.mMetaData != nullptr) {
    scene.mMetaData->Get(name, told);
    scene.mMetaData->Get(std::string(name) + "Sign", told_sign);
  }
  Eigen::RowVector3d row = Eigen::RowVector3d::Zero();
  if (told >= 0 && told <= 2) row[told] = told_sign < 0 ? -1.0 : 1.0;
  return row;
}

/// FBX: to Y up and metres. Its axes are right, up and front; a file that contradicts itself is taken as Y up.
/// @param frame set to what the file says
Matrix4d fbx_root(const aiScene& scene, FileFrame& frame) {
  Eigen::Matrix3d turn;
  turn.row(0) = axis(scene, "CoordAxis", 0, 1);
  turn.row(1) = axis(scene, "UpAxis", 1, 1);
  turn.row(2) = axis(scene, "FrontAxis", 2, 1);
  if (!(std::abs(turn.determinant()) > 0.5)) turn.setIdentity();
  double unit = 1.0;  // centimetres
  if (scene.mMetaData != nullptr) {
    float single = 1.0f;
    if (!scene.mMetaData->Get("UnitScaleFactor", unit) && scene.mMetaData->Get("UnitScaleFactor", single))
      unit = static_cast<double>(single);
  }
  if (!(unit > 0.0) || !std::isfinite(unit)) unit = 1.0;
  for (int k = 0; k < 3; ++k) {
    if (turn(1, k) != 0.0) frame.up = static_cast<char>('X' + k);
  }
  frame.metres = 0.01 * unit;
  Matrix4d result = Matrix4d::Identity();
  result.topLeftCorner<3, 3>() = frame.metres * turn;
  return result;
}

}  // namespace

Matrix4d to_matrix(const aiMatrix4x4& m) {
  Matrix4d result;
  for (unsigned r = 0; r < 4; ++r) {
    for (unsigned c = 0; c < 4; ++c) result(r, c) = static_cast<double>(m[r][c]);
  }
  return result;
}

NodeTable add_nodes(const aiScene& scene, bool is_fbx, gltf_import::Document& document) {
  struct Open {
    const aiNode* node;
    int parent;
    std::vector<const aiNode*> above;  ///< helpers since the parent
  };
  NodeTable table;
  std::vector<Open> open;
  open.push_back({scene.mRootNode, -1, {}});
  while (!open.empty()) {
    Open one = std::move(open.back());
    open.pop_back();
    int parent = one.parent;
    one.above.push_back(one.node);
    const bool folded = is_fbx && one.parent >= 0 && is_helper(*one.node);
    if (!folded) {
      parent = static_cast<int>(document.nodes.size());
      gltf_import::Node node;
      node.name = one.node->mName.C_Str();
      node.parent = one.parent;
      node.matrix = Matrix4d::Identity();
      for (const aiNode* link : one.above) node.matrix = Matrix4d(node.matrix * to_matrix(link->mTransformation));
      if (is_fbx && one.parent < 0) node.matrix = fbx_root(scene, document.frame);
      node.matrix.row(3) = Eigen::RowVector4d(0, 0, 0, 1);
      node.local = decompose(node.matrix, &node.shear);
      if (!node.matrix.allFinite() || !std::isfinite(node.matrix.squaredNorm()) || !node.local.scale.allFinite() ||
          !node.local.rotation.coeffs().allFinite())
        throw InputError(document.file, "node " + node.name, "its transform is not finite");
      if (one.parent >= 0) document.nodes[static_cast<std::size_t>(one.parent)].children.push_back(parent);
      table.node.push_back(one.node);
      table.by_name.emplace(node.name, parent);
      document.nodes.push_back(std::move(node));
      document.top_down.push_back(parent);
      document.in_scene.push_back(1);
      table.chain.push_back(std::move(one.above));
      one.above.clear();
    }
    for (unsigned c = one.node->mNumChildren; c-- > 0;)  // the first child is taken next
      open.push_back({one.node->mChildren[c], parent, one.above});
  }
  return table;
}

void add_mesh_node(gltf_import::Document& document, int parent, int mesh, int skin) {
  gltf_import::Node node;
  const int number = static_cast<int>(document.nodes.size());
  gltf_import::Node& above = document.nodes[static_cast<std::size_t>(parent)];
  node.name = above.name;
  node.parent = parent;
  node.mesh = mesh;
  node.skin = skin;
  node.matrix = Matrix4d::Identity();
  above.children.push_back(number);
  document.nodes.push_back(std::move(node));
  document.top_down.push_back(number);
  document.in_scene.push_back(1);
}

}  // namespace anigen::io::assimp_import
