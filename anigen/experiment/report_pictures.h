#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::experiment {

/// Files under a folder that match a pattern whose parts may be "*" or contain one, such as "*/preview.png"; sorted.
std::vector<std::filesystem::path> matching_files(const std::filesystem::path& folder, const std::string& pattern);

/// A pattern with the name of an asset in place of its star. @pre it has one
std::string file_of_asset(std::string pattern, const std::string& asset);

/// One of several equally wide pictures that a file has side by side, counted from 1.
struct Panel {
  int number = 1, of = 1;
};

/// A picture file, or a panel of it, made `height` pixels high, as an <img> of JPEG that needs no other file. What is
/// wrong with the file, or that there is none (an empty path), stands in its place.
std::string thumbnail(const std::filesystem::path& file, int height, Panel panel = {});

/// A picture file as an <img> that needs no other file. PNG and JPEG; other endings give an empty text.
std::string embedded_picture(const std::filesystem::path& file);

}  // namespace anigen::experiment
