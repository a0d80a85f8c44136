#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::io {

/// The proper rotation from the project's world (Z up) to the file's (Y up). Its entries are exactly -1, 0 or 1,
/// so positions and normals turn without rounding.
Eigen::Matrix3d axis_rotation(ExportAxes axes);

/// Rotation of the axes as a unit quaternion, for joint rotations.
Eigen::Quaterniond axis_quaternion(ExportAxes axes);

/// A skeleton whose joints have these positions and, in a file with these axes, no rotation: bind pose and rest pose
/// are translations alone, as the published exporter writes them (reference flows-and-pipeline.md, 5.11). For skeletons
/// without orientations of their own, such as generated ones. Rest pose = bind pose.
Skeleton unrotated_in_file(const Skeleton& skeleton, ExportAxes axes);

/// glTF's numbers for the OpenGL constants that exporters need.
enum class ComponentType { kUint8 = 5121, kUint16 = 5123, kUint32 = 5125, kFloat = 5126 };
enum class ViewTarget { kNone = 0, kVertices = 34962, kIndices = 34963 };

/// A glTF file being written: its JSON and its only binary buffer. Views and accessors are appended as the parts of
/// the asset are written, each aligned to 4 bytes.
class GltfDocument {
 public:
  GltfDocument();

  Json json;  ///< everything but "buffers", "bufferViews" and "accessors", which json_text() adds

  /// Copies bytes into the buffer. @return the index of the bufferView
  int add_view(const void* data, std::size_t bytes, ViewTarget target);

  /// An accessor into a view. @param type "SCALAR", "VEC3", … @return its index
  int add_accessor(int view, std::size_t byte_offset, ComponentType component, const char* type, std::size_t count);
  /// Adds the accessor's "min" and "max", which are exact because every float is a double.
  void set_bounds(int accessor, const std::vector<float>& values, std::size_t width);

  /// A view of its own with one accessor. @param width numbers per element: 1, 2, 3, 4 or 16
  int add_floats(const std::vector<float>& values, std::size_t width, ViewTarget target);
  int add_uint8(const std::vector<std::uint8_t>& values, std::size_t width, ViewTarget target);
  int add_uint16(const std::vector<std::uint16_t>& values, std::size_t width, ViewTarget target);
  int add_uint32(const std::vector<std::uint32_t>& values, std::size_t width, ViewTarget target);

  const std::string& binary() const { return binary_; }
  /// The finished JSON. @param buffer_uri "uri" of the buffer; empty for the binary chunk of a .glb
  std::string json_text(const std::string& buffer_uri) const;

 private:
  std::string binary_;
  Json views_ = Json::array(), accessors_ = Json::array();
};

/// "SCALAR", "VEC2", "VEC3", "VEC4" or "MAT4" for 1, 2, 3, 4 or 16 numbers per element.
const char* accessor_type(std::size_t width);

/// Writes the only mesh of the file: one primitive per material, all with the same vertex accessors, so that vertex
/// order and count survive. Faces are grouped by material and keep their order within a group.
/// @param rotation  world → file, see axis_rotation
/// @param materials index in the file by index in Asset::materials, from write_materials
void write_mesh(GltfDocument& document, const Asset& asset, const Eigen::Matrix3d& rotation,
                const std::map<int, int>& materials, std::size_t influences);

/// Adds JOINTS_n and WEIGHTS_n (float) for as many sets of four as the rows need, at most `influences` joints each.
/// Joint indices are 8-bit up to 255 joints, else 16-bit. Unused slots hold joint 0 with weight 0.
void write_skin_attributes(GltfDocument& document, Json& attributes, const SkinWeights& skin, std::size_t joints,
                           std::size_t influences);

/// Writes the skin: all joints in skeleton order (their node index is their joint index), the root as "skeleton",
/// and the inverse of rotation · bind as inverse bind matrices.
/// @param file only for the message @throws InputError when a matrix does not fit single precision
void write_skin(GltfDocument& document, const Skeleton& skeleton, const Eigen::Matrix3d& rotation,
                const std::string& file);

/// Writes the scene: node j is joint j in its rest pose, followed by the node that carries mesh and skin. That one
/// stands beside the root joint, not below it, because the transform of a skinned mesh's node is ignored.
void write_nodes(GltfDocument& document, const Asset& asset, ExportAxes axes);

/// Writes the animations, keys and interpolation kept; the root's channels are turned into the file's axes (cubic
/// tangents too: a rotation is linear in them). Keys whose times are equal in single precision are merged; of
/// several channels for one property the last is written, which is the one that sample() obeys; channels without
/// keys are left out.
/// @param file only for the message @throws InputError on a rotation of length zero or a number beyond float
void write_animations(GltfDocument& document, const Asset& asset, ExportAxes axes, const std::string& file);

/// True for .glb, false for .gltf, in any case. @throws InputError on another extension
bool is_binary_extension(const std::filesystem::path& path);

/// The bytes of a .glb: header, JSON chunk, binary chunk (glTF 2.0, section 4.4).
/// @param file only for the message @throws NotSupportedError when it would exceed the format's 4 GiB
std::string glb_bytes(const GltfDocument& document, const std::string& file);

/// The bytes of a .gltf whose buffer is a base64 data URI.
std::string embedded_gltf_bytes(const GltfDocument& document);

}  // namespace anigen::io
