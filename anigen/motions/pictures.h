#pragma once
#include <filesystem>
#include <vector>

#include "anigen/asset/rigged_asset.h"

namespace anigen::motions {

/// Frames of a clip on one sheet: eight moments from a front quarter, and from the side below.
/// @throws InputError as render::render()
void write_clip_sheet(const std::filesystem::path& png, const Asset& asset, const Animation& clip);

/// Numbered frames, 0000.png on, at the clip's keys, 24 at most a second; the camera goes around the asset once.
void write_clip_frames(const std::filesystem::path& folder, const Asset& asset, const Animation& clip);

}  // namespace anigen::motions
