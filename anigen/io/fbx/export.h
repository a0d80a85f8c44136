#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/fbx/binary.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::io {

/// Writes a binary FBX 7.4 file, atomically. The same asset gives the same bytes.
///
/// Frame: Y up, front +Z, one unit is a metre (UnitScaleFactor 100): a reader that follows the unit, as Blender does,
/// needs no scaled node, which centimetres would bring. A node of the asset's name ("Null")
/// holds the mesh and the root joint. Joints are nodes of type LimbNode in the rest pose, the bind pose stands in the
/// clusters and in a Pose, without scales (remove_bind_scales()); every joint has a cluster, so that joints without
/// weights stay joints. Scales are inherited as in glTF (InheritType RSrs).
///
/// Limits of the format: a texture replaces the material's colour; vertex colours are sRGB, as Blender and
/// three.js take them; rotations are Euler angles (euler_keys()); steps are short ramps (kStepRamp).
/// @throws InputError as write_gltf() does; NotSupportedError for names with a zero byte, and above 4 GiB
void write_fbx(const std::filesystem::path& path, const Asset& asset, const ExportOptions& options = {});

}  // namespace anigen::io

namespace anigen::io::fbx_export {

/// Objects and connections of a file being written. Ids count up.
class Scene {
 public:
  Scene();

  /// Adds an object "<name>\0\1<type>" of a class, such as "Model", and kind, such as "LimbNode".
  /// @param record its name, where it is not `type` ("NodeAttribute" is a record, its objects' type may be another)
  /// @return its record; `id` is set
  Record& object(const std::string& record, const std::string& name, const std::string& type, const std::string& kind,
                 std::int64_t& id);
  void connect(std::int64_t child, std::int64_t parent);
  /// @param property of the parent that the child is, or drives
  void connect(std::int64_t child, std::int64_t parent, const std::string& property);

  const std::vector<std::pair<std::string, int>>& counts() const { return counts_; }
  Record objects, connections;

 private:
  std::int64_t next_id_ = 1'000'000;
  std::vector<std::pair<std::string, int>> counts_;  // of each record, in the order of their first one
};

/// Object without a parent: the scene itself.
inline constexpr std::int64_t kSceneRoot = 0;

// Each appends one property "P" to a record Properties70.
void set_int(Record& properties, const std::string& name, int value, const std::string& type = "int");
void set_real(Record& properties, const std::string& name, double value);
void set_vector(Record& properties, const std::string& name, const Eigen::Vector3d& value, const std::string& type,
                const std::string& flags = "A");
void set_text(Record& properties, const std::string& name, const std::string& value);
void set_time(Record& properties, const std::string& name, double seconds);

std::int64_t ticks(double seconds);

/// Appends stacks, layers, curve nodes and curves of the asset's animations. What one of them moves rests in those that
/// do not, by a key: Blender keeps the pose of the clip that was shown before.
/// @param joints [J] ids of the joints' nodes
void add_clips(const Asset& asset, const std::vector<std::int64_t>& joints, Scene& scene);

/// Name of a clip, unique among the asset's.
std::vector<std::string> clip_names(const Asset& asset);

}  // namespace anigen::io::fbx_export
