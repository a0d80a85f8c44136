#pragma once
#include <assimp/scene.h>

#include <Eigen/Core>
#include <string>
#include <unordered_map>
#include <vector>

#include "anigen/io/gltf/import_document.h"

namespace anigen::io::assimp_import {

Eigen::Matrix4d to_matrix(const aiMatrix4x4& matrix);

/// The nodes of a scene. Assimp breaks an FBX model into a chain of helper nodes, one for each pivot, offset and
/// rotation of its transform; these are folded into the nodes below them, so that a joint stays one joint.
struct NodeTable {
  std::vector<const aiNode*> node;                ///< [N] in the order of document.nodes, parents first
  std::vector<std::vector<const aiNode*>> chain;  ///< [N] what a node's transform is the product of, itself last
  std::unordered_map<std::string, int> by_name;   ///< the first node of each name
};

/// Appends the nodes to an empty document, parents before children, without meshes. For FBX, the root gets the up axis
/// and the unit that the file's metadata tell (to glTF's: Y up, metres), which document.frame keeps; COLLADA's already
/// has them.
/// @throws InputError when a transform is not finite
NodeTable add_nodes(const aiScene& scene, bool is_fbx, gltf_import::Document& document);

/// Appends a node below another that shows a mesh.
void add_mesh_node(gltf_import::Document& document, int parent, int mesh, int skin);

}  // namespace anigen::io::assimp_import
