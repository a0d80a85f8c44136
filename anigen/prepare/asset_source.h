#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::prepare {

/// Where one asset of a dataset comes from: a rigged file, or a number of the procedural generator.
struct AssetSource {
  std::filesystem::path file;   ///< empty for a procedural creature
  std::string local_path;       ///< of the file, relative to the input folder, with '/'; empty for a creature
  std::string file_identifier;  ///< "<input folder>/<local path>" or "procedural/<seed>/<index>"
  std::uint64_t seed = 0;       ///< of a creature
  std::uint64_t index = 0;      ///< of a creature

  bool procedural() const { return file.empty(); }
};

/// Every .glb and .gltf under the folders, links not followed, sorted by path inside each folder. An input may
/// also be a single file. @throws InputError when an input does not exist or holds no such file
std::vector<AssetSource> find_assets(const std::vector<std::filesystem::path>& inputs);

/// Creatures 0 … count - 1 of a seed.
std::vector<AssetSource> procedural_sources(std::uint64_t seed, std::size_t count);

/// The entry's `sha256`: of the bytes of a .glb; of a .gltf's JSON followed by its external buffers in order; of
/// "procedural/<seed>/<index>/<recipe version>" for a creature, so that a changed recipe gives new entries.
/// @throws InputError when the file, or a buffer it names, cannot be read
std::string asset_id(const AssetSource& source);

}  // namespace anigen::prepare
