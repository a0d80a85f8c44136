#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"

namespace anigen::io {

/// One thing the importer changed or noticed, for reports: a stable short code ("nan_weights") and a sentence.
struct ImportNote {
  std::string code;
  std::string message;
};

struct ImportOptions {
  std::uintmax_t max_file_bytes = std::uintmax_t{1} << 30;  ///< the file and each buffer it refers to
  std::size_t max_vertices = 20'000'000;
  std::size_t max_faces = 40'000'000;
  std::size_t max_joints = 10'000;
  std::size_t max_nodes = 200'000;
  std::size_t max_json_depth = 128;
  int scene = -1;  ///< index of the scene to import; -1: the file's default scene, else the first
  /// False: a file without a skin is read, too. One that shows triangles is a mesh without a rig, one that does not but
  /// moves nodes is a skeleton of those and the nodes below them; a skin that no mesh shows is a skeleton as well.
  bool require_rig = true;
};

/// Frame that a file declares, before it was turned to Z up.
struct FileFrame {
  char up = 'Y';        ///< 'X', 'Y' or 'Z'
  double metres = 1.0;  ///< one unit of the file; what was read is in metres
};

/// An animation whose nodes are not joints.
struct NodeClip {
  std::string name;
  double seconds = 0.0;
  std::size_t tracks = 0;
};

struct ImportedAsset {
  Asset asset;  ///< world frame Z up: glTF (X, Y, Z) → (X, −Z, Y); validate() finds nothing wrong with it
  std::vector<ImportNote> notes;
  FileFrame frame = {};
  std::vector<NodeClip> node_clips = {};  ///< of a mesh without a rig: what its file animates
  double lowest_weight_sum = 1.0;  ///< of a vertex with weights in the file, before rows were divided by their sum
};

/// Reads a skinned glTF 2.0 (.gltf with its buffers, or .glb). All skins are merged into one skeleton, all meshes
/// into one mesh in a common bind pose. A mesh without a rig, which options.require_rig = false allows, keeps its place
/// in the scene. @throws InputError with file and place, NotSupportedError naming an extension
ImportedAsset read_gltf(const std::filesystem::path& path, const ImportOptions& options = {});

/// Reads a file that is in memory, a .glb or a .gltf with everything embedded. @param name of the asset, for messages
/// @throws InputError likewise, also for a buffer or an image of another file
ImportedAsset read_gltf_bytes(std::string bytes, const std::string& name, const ImportOptions& options = {});

enum class ExportAxes {
  kGltf,      ///< exact inverse of the import: (x, y, z) → (x, z, −y)
  kPublished  ///< the published exporter's (−x, z, y), turned by 180° about the vertical
};

/// Members of "extensions" at the top of a file, by name, such as {"VRMC_vrm": {…}}, given the node of each joint.
/// Their names are added to "extensionsUsed".
using RootExtensions = std::function<Json(const std::vector<int>& node_of_joint)>;

struct ExportOptions {
  std::size_t influences = 4;  ///< per vertex; more than 4 writes JOINTS_1/WEIGHTS_1 and so on
  ExportAxes axes = ExportAxes::kGltf;
  bool animations = true;
  bool require_rig = true;  ///< false: a mesh without a rig, or a skeleton without a mesh, is written, too
  RootExtensions extensions = {};
};

/// Writes a .glb or .vrm (or .gltf with everything embedded, by extension), atomically; zero errors in Khronos'
/// validator.
/// @throws InputError when validate() finds something wrong with the asset, or a mesh has no faces
void write_gltf(const std::filesystem::path& path, const Asset& asset, const ExportOptions& options = {});

/// Contents of the file that write_gltf() would write. @param name for messages @throws InputError likewise
std::string gltf_bytes(const std::string& name, const Asset& asset, bool binary, const ExportOptions& options = {});

}  // namespace anigen::io
