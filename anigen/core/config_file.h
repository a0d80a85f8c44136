#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"

namespace anigen {

/// Reads a JSON config. `"extends": "other.json"` (or a list of files, later ones winning), relative to the file
/// that says it, is read first and then overlaid by merge_config(); chains may be 16 files long.
/// @return the merged config without "extends" @throws InputError for an unreadable file, a cycle, a longer chain,
/// or a file whose top level is not an object
Json load_config(const std::filesystem::path& path);

/// Overlays `changes` on `base`: objects merge key by key, everything else is replaced. An object that carries
/// another "name" than the one below it replaces that one whole, since the arguments of one model, dataset,
/// trainer or schedule mean nothing to another.
void merge_config(Json& base, const Json& changes);

/// Applies one `path.to.key=value` (numbers index into lists). The value is parsed as JSON and, when that fails,
/// taken as a string. Missing objects on the way are created: whether a new key means anything is for the reader
/// of the config to say, which reports unknown keys.
/// @throws InputError when there is no '=', the path is empty or passes through something that is not an object
void apply_override(Json& config, const std::string& assignment);
void apply_overrides(Json& config, const std::vector<std::string>& assignments);

/// Two-space indented text with a final newline; written atomically.
void write_config(const std::filesystem::path& path, const Json& config);

}  // namespace anigen
