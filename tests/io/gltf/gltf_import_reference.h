#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <limits>
#include <vector>

namespace anigen::test {

/// glTF's skinning formula evaluated directly on a file, by another reader (tinygltf) and without any of the
/// importer's ideas: v → Σ w_j · world(node_j) · inverse_bind_j · v for skinned vertices, world(node) · v for others.
class GltfReference {
 public:
  /// @throws std::runtime_error when tinygltf refuses the file
  explicit GltfReference(const std::filesystem::path& path);
  ~GltfReference();
  GltfReference(const GltfReference&) = delete;
  GltfReference& operator=(const GltfReference&) = delete;

  std::size_t animations() const;
  double duration(std::size_t animation) const;

  /// Vertices of the scene in our Z-up frame, at rest or at a time of an animation. Meshes in the order of the file;
  /// within one, blocks of vertices (primitives that share attributes count once), each for every node in turn.
  /// Vertices without usable weights are NaN.
  std::vector<Eigen::Vector3f> vertices(int animation = -1, double time = 0.0) const;
  /// Indices of those that belong to a mesh without skin and without a joint above it; glTF leaves those where they
  /// are.
  std::vector<bool> follows_no_joint() const;
  std::size_t triangles() const;  ///< of list primitives of meshes in the scene, without those that repeat a vertex

 private:
  struct Model;
  Model* model_;
};

}  // namespace anigen::test
