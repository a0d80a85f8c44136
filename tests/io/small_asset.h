#pragma once
#include <cstdint>
#include <vector>

#include "anigen/asset/rigged_asset.h"

namespace anigen::test {

/// A valid PNG of 2 × 2 pixels (red, green, blue, white).
std::vector<std::uint8_t> tiny_png();

/// Bytes of a PNG, wrapped for Asset::images.
EncodedImage tiny_texture();

/// A strip of `segments` quads along +Z (2 · (segments + 1) vertices) on a chain of `joints` joints, root at the
/// bottom, each joint turned a little about Y against its parent. All joints but the root rest away from the bind pose.
/// Normals, uvs and colours, two materials (the second textured); vertex v is bound to `influences` joints around
/// its height; one animation with a linear rotation of the root, a step scale and a cubic translation.
Asset small_asset(std::size_t joints = 3, std::size_t segments = 4, std::size_t influences = 2);

}  // namespace anigen::test
