#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/prepare/steps/asset_places.h"

namespace anigen::prepare {

/// The files of a step that an asset's record names, under the options that the record holds; for whoever checks a
/// dataset without its plan, its sources or a feature extractor. Empty for a step that leaves none, or that this
/// version does not know.
std::vector<std::filesystem::path> recorded_files(const std::string& step, const Json& options,
                                                  const AssetPlaces& places);

}  // namespace anigen::prepare
