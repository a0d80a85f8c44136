#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::pipeline {

/// A picture and what its asset is to be called.
struct NamedPicture {
  std::filesystem::path file;
  std::string name;
  std::filesystem::path
      normal_map;  ///< the surface normals seen in it, as normal_picture() colours them; empty: unknown
  NamedPicture(std::filesystem::path picture);  ///< called as the file, without its ending
  NamedPicture(std::filesystem::path picture, std::string called);
};

/// A picture, or the pictures directly in a folder by name: png, jpg, jpeg, webp, bmp, tif, tiff.
/// @throws InputError when there is none
std::vector<NamedPicture> pictures_at(const std::filesystem::path& path);

/// The first condition view of every asset that the splits name, called as the asset, with its true normals where
/// the dataset has them (anigen-prepare --view-geometry).
/// @param most only so many of the first; 0: all @throws InputError naming the asset that has no such view
std::vector<NamedPicture> pictures_of_dataset(const std::filesystem::path& dataset,
                                              const std::vector<std::filesystem::path>& splits, std::size_t most);

/// @throws InputError when two pictures have one name, whose assets would overwrite each other
void require_distinct_names(const std::vector<NamedPicture>& pictures);

}  // namespace anigen::pipeline
