#pragma once
#include <filesystem>

#include "anigen/asset/asset.h"

namespace anigen::prepare {

/// Largest dense weight matrix that is written, in bytes.
inline constexpr std::size_t kMaxDenseSkinBytes = std::size_t{2} << 30;

/// Writes skeleton_voxelized.npz (reference training-and-data.md, 1.1): joints f32 [J, 3], parents i32 [J] with -1
/// for the root at index 0, skin f32 [V, J] dense, vertices f32 [V, 3], faces i32 [F, 3]. The asset is written in
/// the frame it is in; the layout wants it normalised. Atomic; equal assets give equal bytes.
/// @throws InputError when the dense weights would exceed kMaxDenseSkinBytes
void write_skeleton_archive(const std::filesystem::path& path, const Asset& asset);

}  // namespace anigen::prepare
