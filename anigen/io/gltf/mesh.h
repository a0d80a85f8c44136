#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/gltf/primitive.h"
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

/// Placement of a vertex block: positions by `matrix`, normals by its inverse transpose.
class Placement {
 public:
  explicit Placement(const Eigen::Matrix4d& matrix);
  Eigen::Vector3f position(const VertexBlock& block, std::size_t vertex) const;
  /// Unit length; zero when the file has no usable normal for the vertex.
  Eigen::Vector3f normal(const VertexBlock& block, std::size_t vertex) const;
  /// A mirroring turns triangles inside out.
  bool is_mirroring() const { return is_mirroring_; }

 private:
  Eigen::Matrix4d matrix_;
  Eigen::Matrix3d normal_matrix_;
  bool is_mirroring_;
};

/// The arrays of the merged mesh while primitives are appended to it.
class MeshArrays {
 public:
  explicit MeshArrays(const std::string& file) : file_(file) {}

  std::size_t vertices() const { return mesh_.vertices.size(); }
  std::size_t faces() const { return mesh_.faces.size(); }
  Eigen::Vector3f vertex(std::size_t v) const { return mesh_.vertices[v]; }
  /// @throws InputError when the vertex leaves the range of float
  void add_vertex(const VertexBlock& block, std::size_t vertex, const Placement& placement);
  /// Faces of a block whose first vertex got the number `first_vertex`.
  void add_faces(const std::vector<Triangle>& faces, std::size_t first_vertex, bool turn_around, int material);

  /// Attributes that only some primitives had are filled up for the others: uv 0, white, the normal of the faces.
  /// @throws InputError when there are no faces
  Mesh finish(Notes& notes);

 private:
  const std::string& file_;
  Mesh mesh_;
  bool any_normals_ = false, any_uvs_ = false, any_colors_ = false;
};

}  // namespace anigen::io::gltf_import
