#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/rig_reader.h"

namespace anigen::prepare {

/// Source of one asset of a dataset: a rig on disk, or a number of the procedural generator. Plain data: as JSON
/// it can be handed to another process, which opens it again.
struct AssetSource {
  io::RigFormat format = io::RigFormat::kGltf;  ///< not used for a creature
  std::filesystem::path file;                   ///< empty for a procedural creature; a dataset's folder
  std::string key;                              ///< sample inside the file, or empty
  std::string local_path;                       ///< relative to the input folder, with '/'; empty for a creature
  std::string file_identifier;                  ///< "<input folder>/<local path>" or "procedural/<seed>/<index>"
  bool is_test = false;                         ///< the source itself keeps it for testing (io::RigEntry)
  std::string uuid;                             ///< what the sample is called in its shard (io::RigEntry); or empty
  std::uint64_t seed = 0;                       ///< of a creature
  std::uint64_t index = 0;                      ///< of a creature
  std::string variant_of{};                     ///< asset of its dataset of which it is a pose (io::RigEntry); or empty

  bool procedural() const { return file.empty(); }
  /// local_path without the sample in the shard.
  std::string source_path() const;
  io::RigEntry rig() const { return {format, file, key, local_path, is_test, uuid, variant_of}; }
};

void to_json(Json& json, const AssetSource& source);
/// @throws InputError naming the JSON pointer
void from_json(const Json& json, AssetSource& source);

/// Every rigged asset under the inputs, as io::list_rigs finds them, inputs in the order given. @throws InputError when
/// an input does not exist or holds nothing that can be read
std::vector<AssetSource> find_assets(const std::vector<std::filesystem::path>& inputs);

/// Creatures 0 … count - 1 of a seed.
std::vector<AssetSource> procedural_sources(std::uint64_t seed, std::size_t count);

/// The creatures of a shard of a stream: `count` indices that no other shard has, of a seed that no test creature has.
/// @throws InputError for a seed so large that it would leave the range of streams (creature_seeds)
std::vector<AssetSource> stream_sources(std::uint64_t seed, std::uint64_t shard, std::size_t count);

/// The entry's `sha256`: io::RigReader::content_id() of a rig on disk; of "procedural/<seed>/<index>/<recipe version>"
/// for a creature, so that a changed recipe gives new entries; of a published dataset the id it has there.
/// @param reader kept by the caller over many calls, so that shards are not opened for every sample
/// @throws InputError when the file, or a buffer it names, cannot be read
std::string asset_id(const AssetSource& source, const io::RigReader& reader = io::RigReader());

/// Largest dense weight matrix that is written, in bytes.
inline constexpr std::size_t kMaxDenseSkinBytes = std::size_t{2} << 30;

/// Writes skeleton_voxelized.npz (docs/reference/training.md, 1.1): joints f32 [J, 3], parents i32 [J] with -1 for the
/// root at index 0, skin f32 [V, J] dense, vertices f32 [V, 3], faces i32 [F, 3]. The asset is written in the frame it
/// is in; the layout wants it normalised. Atomic; equal assets give equal bytes.
/// @throws InputError when the dense weights would exceed kMaxDenseSkinBytes
void write_skeleton_archive(const std::filesystem::path& path, const Asset& asset);

/// Distance of the two most similar bones: the smallest, over pairs of joints other than the root, of the
/// largest coordinate difference between their vectors from the parent. The skin auto-encoder tells joints apart by
/// these vectors (docs/reference/autoencoders.md, 2.1), so equal ones give equal tokens.
/// @param joints [J] normalised positions @param parents [J], -1 for the root
/// @return kNoPair with fewer than two bones
inline constexpr double kNoPair = 1e9;
double closest_bones(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents);

/// The share of joints outside the mesh (geometry::InsideTest); those within 1e-4 of the diagonal of its box from the
/// surface are inside. A sheet, whose area vectors add up to half of its area or more, surrounds nothing: there its box
/// decides. @return 0 without joints
double outside_share(const std::vector<Eigen::Vector3d>& joints, const Mesh& mesh);

/// Limits that decide `is_bad_skeleton` and `is_bad_skin`.
struct QualityLimits {
  std::size_t min_joints = 3;
  std::size_t max_joints = 100;
  /// Bones no farther apart than this count as equal. The default is far above the rounding of float32 joints, which
  /// hides equal bones of symmetric rigs from an exact comparison, and far below any difference that shows.
  double same_bone = 1e-6;
  double max_outside_share = 0.7;   ///< of joints outside the mesh (Anymate's limit)
  double max_invented_rows = 0.01;  ///< share of vertices whose weights the importer had to make up
  double least_weight_sum = 0.9;    ///< of any vertex, in the file (what Articulation-XL 2.0 was cleaned by)
};
ANIGEN_JSON_RECORD(QualityLimits, min_joints, max_joints, same_bone, max_outside_share, max_invented_rows,
                   least_weight_sum)

}  // namespace anigen::prepare
