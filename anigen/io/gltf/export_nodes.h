#pragma once
#include "anigen/asset/asset.h"
#include "anigen/io/gltf.h"
#include "anigen/io/gltf/export_document.h"

namespace anigen::io {

/// Writes the scene: node j is joint j in its rest pose, followed by the node that carries mesh and skin. That one
/// stands beside the root joint, not below it, because the transform of a skinned mesh's node is ignored.
void write_nodes(GltfDocument& document, const Asset& asset, ExportAxes axes);

}  // namespace anigen::io
