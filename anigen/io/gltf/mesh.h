#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/gltf/rig.h"

namespace anigen::io::gltf_import {

/// The vertices of one primitive, as one node shows it, in the merged mesh: all of them, in the primitive's order.
/// Primitives of a mesh that have their vertices in common have the range in common, too.
struct VertexRange {
  int node = -1, mesh = -1, primitive = -1;               ///< of the file; the primitive counts within its mesh
  std::size_t first = 0, count = 0;                       ///< of the merged mesh's vertices
  bool is_skinned = false;                                ///< by the skin of its node
  Eigen::Matrix4d to_bind = Eigen::Matrix4d::Identity();  ///< the primitive's own space → bind pose, Z up
  double deviation = 0.0;  ///< largest distance of a vertex from its place by to_bind (SkinBinding::deviation)
};

struct MergedMesh {
  Mesh mesh;  ///< bind pose, Z up; face_materials refer to the file's materials
  SkinWeights skin;
  std::vector<VertexRange> ranges = {};  ///< of every primitive that has vertices here, by first vertex
};

/// Every mesh of the scene in one, in the bind pose. A skinned mesh ignores its node's transform (glTF 2.0, section
/// 3.7.3.3); a mesh without skin follows the joint above its node, or the root when there is none.
/// Without a joint in the rig, vertices keep their place in the scene and have no weights.
/// @throws InputError when nothing with triangles is left; not for a skeleton whose mesh options.require_rig lets be
/// missing
MergedMesh merge_meshes(const Document& document, const Rig& rig, const std::vector<SkinBinding>& bindings,
                        const ImportOptions& options, Notes& notes);

}  // namespace anigen::io::gltf_import
