#pragma once
#include <assimp/scene.h>

#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/rigs/assimp_scene.h"

namespace anigen::io::assimp_import {

/// Appends every mesh that a node shows, with its bones as a skin. Vertices that agree in everything, weights
/// included, become one: FBX meshes come with a vertex per corner.
/// @throws InputError when a bone's node is missing
void add_meshes(const aiScene& scene, const NodeTable& nodes, gltf_import::Document& document,
                gltf_import::Notes& notes);

/// Appends the animations of nodes. Keys of a node without folded helpers stay as they are; of others, the product is
/// taken apart at the times of all keys of its chain. Times become seconds, from 0 where a file starts before that.
/// @throws InputError when there are too many keys
void add_animations(const aiScene& scene, const NodeTable& nodes, gltf_import::Document& document);

}  // namespace anigen::io::assimp_import
