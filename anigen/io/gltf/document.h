#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "anigen/asset/animation.h"
#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::io::gltf_import {

/// A glTF file after every index, range and number in it was checked: later stages read it without checks of
/// their own. Indices are -1 where the file gives none. Units and axes are glTF's (metres, Y up).

enum class Component { kI8 = 5120, kU8 = 5121, kI16 = 5122, kU16 = 5123, kU32 = 5125, kF32 = 5126 };

inline bool is_unsigned(Component component) {
  return component == Component::kU8 || component == Component::kU16 || component == Component::kU32;
}

struct BufferView {
  std::string_view bytes;  ///< decoded when the file compresses it
  std::size_t stride = 0;  ///< 0: packed
};

/// Location of numbers: `count` elements of `width` components, every one inside its view.
struct Accessor {
  std::string pointer;  ///< JSON pointer, for messages
  int view = -1;        ///< -1: zeros
  std::size_t offset = 0, stride = 0, count = 0, width = 1;
  Component component = Component::kF32;
  bool normalized = false;
  std::string type;
  /// Sparse replacement: `count` indices and values.
  struct Sparse {
    std::size_t count = 0;
    int index_view = -1, value_view = -1;
    std::size_t index_offset = 0, value_offset = 0;
    Component index_component = Component::kU16;
  } sparse;
};

struct Node {
  std::string name;
  int parent = -1, mesh = -1, skin = -1;
  std::vector<int> children;
  Transform local;         ///< nearest T · R · S when the file gives a matrix
  Eigen::Matrix4d matrix;  ///< exact local matrix
  double shear = 0.0;      ///< what `local` loses of `matrix`, relative
};

struct Skin {
  std::string pointer;
  std::vector<int> joints;         ///< nodes, no repeats
  int inverse_bind_accessor = -1;  ///< -1: identities
};

struct Primitive {
  std::string pointer;
  std::vector<std::pair<std::string, int>> attributes;  ///< name, accessor
  int indices = -1, material = -1, mode = 4;
  bool has_targets = false;
  int draco_view = -1;                                                  ///< KHR_draco_mesh_compression
  std::vector<std::pair<std::string, std::uint32_t>> draco_attributes;  ///< name, unique id inside the Draco data

  int attribute(const std::string& name) const {
    for (const auto& [key, accessor] : attributes) {
      if (key == name) return accessor;
    }
    return -1;
  }
};

struct MeshEntry {
  std::vector<Primitive> primitives;
};

/// uv' = rotation-and-scale · uv + offset (KHR_texture_transform), applied to texture coordinate set `set`.
struct TextureUse {
  int texture = -1, set = 0;
  Eigen::Matrix2d linear = Eigen::Matrix2d::Identity();
  Eigen::Vector2d offset = Eigen::Vector2d::Zero();
  bool is_transformed = false;
};

struct MaterialEntry {
  Material material;  ///< `image` is not set yet
  TextureUse base_color;
};

struct ImageEntry {
  std::string pointer, name, uri;
  int view = -1;
};

struct AnimationChannel {
  std::string pointer;
  int node = -1, input = -1, output = -1;
  ChannelPath path = ChannelPath::kTranslation;
  Interpolation interpolation = Interpolation::kLinear;
};

struct AnimationEntry {
  std::string name;
  std::vector<AnimationChannel> channels;
};

struct Document {
  std::string file;
  FileFrame frame;
  std::vector<std::unique_ptr<std::string>> storage;  ///< what the views point into, beside the container
  std::vector<BufferView> views;
  std::vector<Accessor> accessors;
  std::vector<Node> nodes;
  std::vector<int> top_down;   ///< all nodes, parents before children
  std::vector<char> in_scene;  ///< per node
  std::vector<Skin> skins;
  std::vector<MeshEntry> meshes;
  std::vector<MaterialEntry> materials;
  std::vector<int> texture_images;  ///< per texture, its image or -1
  std::vector<ImageEntry> images;
  std::vector<AnimationEntry> animations;

  /// Keeps bytes for a view. @return what the view sees
  std::string_view keep(std::string bytes) {
    storage.push_back(std::make_unique<std::string>(std::move(bytes)));
    return *storage.back();
  }
};

/// "image/png" or "image/jpeg" by the first bytes; nullptr for other pictures, which glTF does not know.
const char* picture_mime_type(std::string_view bytes);

/// glTF's words for them.
const char* name_of(ChannelPath path);
const char* name_of(Interpolation interpolation);

/// Checks a glTF's JSON and its buffers and turns them into a Document. @throws InputError, NotSupportedError
/// @param container must outlive the result, whose views may point into its binary chunk
Document parse_document(const Container& container, const ImportOptions& options, Notes& notes);

/// The parts of parse_document() that concern bytes and numbers.
void parse_buffers(const JsonPlace& root, const Container& container, const ImportOptions& options, Document& document,
                   Notes& notes);
void parse_accessors(const JsonPlace& root, const ImportOptions& options, Document& document);

/// Largest offset or length that is read: well inside 64 bits, so that sums cannot overflow.
inline constexpr std::uint64_t kMostBufferBytes = std::uint64_t{1} << 40;

/// Last step of every importer that fills a Document: one skeleton, one mesh in its bind pose, materials, animations,
/// or what of these options.require_rig lets be missing; repaired where the file is wrong. @param path of the file;
/// pictures are read from its folder
/// @throws InputError also when the result is no sound asset
ImportedAsset document_asset(const Document& document, const std::filesystem::path& path, const ImportOptions& options,
                             Notes& notes);

}  // namespace anigen::io::gltf_import
