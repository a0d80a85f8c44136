#pragma once
#include <assimp/scene.h>

#include "anigen/io/gltf/import_document.h"
#include "anigen/io/rigs/assimp_nodes.h"

namespace anigen::io::assimp_import {

/// Appends the animations of nodes. Keys of a node without folded helpers stay as they are; of others, the product is
/// taken apart at the times of all keys of its chain. Times become seconds, from 0 where a file starts before that.
/// @throws InputError when there are too many keys
void add_animations(const aiScene& scene, const NodeTable& nodes, gltf_import::Document& document);

}  // namespace anigen::io::assimp_import
