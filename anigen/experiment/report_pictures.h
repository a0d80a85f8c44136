#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::experiment {

/// Files under a folder that match a pattern whose parts may be "*" or contain one, such as "*/preview.png"; sorted.
std::vector<std::filesystem::path> matching_files(const std::filesystem::path& folder, const std::string& pattern);

/// A pattern with the name of an asset in place of its star. @pre it has one
std::string file_of_asset(std::string pattern, const std::string& asset);

/// A picture file as an <img> that needs no other file. PNG and JPEG; other endings give an empty text.
std::string embedded_picture(const std::filesystem::path& file);

}  // namespace anigen::experiment
