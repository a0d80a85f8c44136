#pragma once
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/gltf/rig.h"

namespace anigen::io::gltf_import {

struct MergedMesh {
  Mesh mesh;  ///< bind pose, Z up; face_materials refer to the file's materials
  SkinWeights skin;
};

/// Every mesh of the scene in one, in the bind pose. A skinned mesh ignores its node's transform (glTF 2.0, section
/// 3.7.3.3); a mesh without skin follows the joint above its node, or the root when there is none.
/// Without a joint in the rig, vertices keep their place in the scene and have no weights.
/// @throws InputError when nothing with triangles is left; not for a skeleton whose mesh options.require_rig lets be
/// missing
MergedMesh merge_meshes(const Document& document, const Rig& rig, const std::vector<SkinBinding>& bindings,
                        const ImportOptions& options, Notes& notes);

}  // namespace anigen::io::gltf_import
