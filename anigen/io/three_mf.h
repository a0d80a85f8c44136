#pragma once
#include <cstddef>
#include <filesystem>

#include "anigen/asset/mesh.h"

namespace anigen::io {

struct ThreeMfLimits {
  std::size_t max_vertices = 20'000'000, max_faces = 40'000'000;  ///< of all built objects together
};

/// The surface of a 3MF file: every mesh object that its `build` names, by itself or as a component, where it is placed
/// (3MF core specification 1.3). Objects for support (`type="support"`) are left out, and so are materials, textures
/// and slices. Z up, as the format says.
/// @return in metres, by the file's unit
/// @throws InputError naming file and element: no zip archive, no model, cut short, a number or index that is wrong,
/// objects that contain themselves or are nested deeper than 64, more than the limits; NotSupportedError for parts in
/// other files of the archive (production extension), for a DOCTYPE and for text in UTF-16
Mesh read_three_mf(const std::filesystem::path& path, const ThreeMfLimits& limits = {});

}  // namespace anigen::io
