#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::experiment {

/// The folder of the npm package "three", looked for as Node does: node_modules of `start` and of the folders above it,
/// then the folders of NODE_PATH; and beside each node_modules in .cache/node, where scripts/setup.sh puts it.
/// @return empty when there is none
std::filesystem::path find_three(const std::filesystem::path& start);

/// An import map, {"imports": …}, that holds three.js itself with what viewer.mjs needs, so that a page needs neither
/// files nor a network: every module is a data: URL, and imports between them are renamed.
/// @param three as find_three() gives it @throws InputError naming the file that is missing
std::string three_import_map(const std::filesystem::path& three);

}  // namespace anigen::experiment
