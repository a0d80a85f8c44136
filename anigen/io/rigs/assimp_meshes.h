#pragma once
#include <assimp/scene.h>

#include "anigen/io/gltf/import_document.h"
#include "anigen/io/gltf/import_notes.h"
#include "anigen/io/rigs/assimp_nodes.h"

namespace anigen::io::assimp_import {

/// Appends every mesh that a node shows, with its bones as a skin. Vertices that agree in everything, weights
/// included, become one: FBX meshes come with a vertex per corner.
/// @throws InputError when a bone's node is missing
void add_meshes(const aiScene& scene, const NodeTable& nodes, gltf_import::Document& document,
                gltf_import::Notes& notes);

}  // namespace anigen::io::assimp_import
