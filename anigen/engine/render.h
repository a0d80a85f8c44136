#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/job.h"

namespace anigen::engine {

struct RenderOptions {
  int width = 512, height = 512;  ///< pixels, 1 … 16384
  std::string mode = "color";     ///< color, normals, weights
  bool skeleton = false;          ///< bones and joints over the picture
  bool transparent = false;       ///< no background
  double yaw = 30.0;              ///< of the camera about Z, degrees; 0 looks at the front of what faces −y
  double pitch = 15.0;            ///< of the camera above the horizon, degrees
  int clip = -1;                  ///< of Asset::animations; -1: the bind pose
  double time = 0.0;              ///< seconds into the clip
};

/// 8-bit picture, rows from top to bottom, channels interleaved: RGBA.
struct Picture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;  ///< 4 · width · height
};

/// Draws an asset by ray tracing. @throws InputError for an option out of range, or a malformed asset; Interrupted
Picture render(const Asset& asset, const RenderOptions& options = {}, Job* job = nullptr);

/// The picture as a PNG file in memory.
std::string png_bytes(const Picture& picture);

}  // namespace anigen::engine
