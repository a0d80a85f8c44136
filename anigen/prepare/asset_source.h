#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/rig_reader.h"

namespace anigen::prepare {

/// Where one asset of a dataset comes from: a rig on disk, or a number of the procedural generator. Plain data: as JSON
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

  bool procedural() const { return file.empty(); }
  /// local_path without the sample in the shard.
  std::string source_path() const;
  io::RigEntry rig() const { return {format, file, key, local_path, is_test, uuid}; }
};

/// @throws InputError naming the JSON pointer
Json to_json(const AssetSource& source);
AssetSource asset_source_from_json(const Json& json);

/// Every rigged asset under the inputs, as io::list_rigs finds them, inputs in the order given. @throws InputError when
/// an input does not exist or holds nothing that can be read
std::vector<AssetSource> find_assets(const std::vector<std::filesystem::path>& inputs);

/// Creatures 0 … count - 1 of a seed.
std::vector<AssetSource> procedural_sources(std::uint64_t seed, std::size_t count);

/// The entry's `sha256`: io::RigReader::content_id() of a rig on disk; of "procedural/<seed>/<index>/<recipe version>"
/// for a creature, so that a changed recipe gives new entries; of a published dataset the id it has there.
/// @param reader kept by the caller over many calls, so that shards are not opened for every sample
/// @throws InputError when the file, or a buffer it names, cannot be read
std::string asset_id(const AssetSource& source, const io::RigReader& reader);
std::string asset_id(const AssetSource& source);

}  // namespace anigen::prepare
