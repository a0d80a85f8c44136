#pragma once
#include <assimp/scene.h>
#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <string>
#include <type_traits>
#include <unordered_map>
#include <vector>

#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"

namespace anigen::io::assimp_import {

/// Puts arrays into a document as accessors, so that the stages of the glTF importer can read them.
class DocumentArrays {
 public:
  explicit DocumentArrays(gltf_import::Document& document) : document_(document) {}

  /// @param values [count, width of type], row-major, of float or unsigned integers @param type "SCALAR", "VEC3", …
  /// @return the accessor
  template <typename T>
  int add(const std::vector<T>& values, const std::string& type, std::size_t width, const std::string& place) {
    using gltf_import::Component;
    constexpr Component kComponent = std::is_floating_point_v<T> ? Component::kF32
                                     : sizeof(T) == 2            ? Component::kU16
                                                                 : Component::kU32;
    return add(values.data(), values.size() * sizeof(T), sizeof(T), kComponent, type, width, place);
  }
  /// @return the view
  int add_bytes(std::string bytes);

 private:
  int add(const void* values, std::size_t bytes, std::size_t item, gltf_import::Component component,
          const std::string& type, std::size_t width, const std::string& place);

  gltf_import::Document& document_;
};

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

/// Appends every mesh that a node shows, with its bones as a skin. Vertices that agree in everything, weights
/// included, become one: FBX meshes come with a vertex per corner.
/// @param srgb_colors vertex colours are sRGB, as Blender and three.js take those of FBX, and become linear
/// @throws InputError when a bone's node is missing
void add_meshes(const aiScene& scene, const NodeTable& nodes, bool srgb_colors, gltf_import::Document& document,
                gltf_import::Notes& notes);

/// Appends the animations of nodes. Keys of a node without folded helpers stay as they are; of others, the product is
/// taken apart at the times of all keys of its chain. Times become seconds, from 0 where a file starts before that.
/// @throws InputError when there are too many keys
void add_animations(const aiScene& scene, const NodeTable& nodes, gltf_import::Document& document);

/// Appends the materials with the textures of their base colour: embedded PNG and JPEG pictures, and files that lie
/// where the material says or, since exporters write paths of the author's disk, under that name beside the model or in
/// its folder "textures". Nothing outside the model's folder is looked at.
void add_materials(const aiScene& scene, const std::filesystem::path& folder, gltf_import::Document& document);

}  // namespace anigen::io::assimp_import
