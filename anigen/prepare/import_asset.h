#pragma once
#include <string>
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/io/gltf.h"
#include "anigen/prepare/asset_source.h"
#include "anigen/prepare/metadata.h"

namespace anigen::prepare {

struct PreparedAsset {
  Asset asset;  ///< normalised into [-0.5, 0.5]³, Z up
  AssetRecord record;
};

/// Reads or generates the asset, normalises it, cleans it and measures it. Creatures are not cleaned.
/// @param reader kept by the caller over many calls, so that shards are not opened for every sample
/// @throws InputError, NotSupportedError for a file that cannot be used, CleanedOut when a rule drops it
PreparedAsset import_asset(const AssetSource& source, const CleaningOptions& cleaning, const io::RigReader& reader);
/// The same without cleaning.
PreparedAsset import_asset(const AssetSource& source);

/// How many vertices got weights that were not in the file, as the importer's notes tell.
std::size_t invented_rows(const std::vector<io::ImportNote>& notes);

}  // namespace anigen::prepare
