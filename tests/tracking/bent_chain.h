#pragma once
#include <cmath>
#include <vector>

#include "anigen/asset/rigged_asset.h"

namespace anigen::test {

/// A flat bar along z from −0.5 to 0.5 of 20 rings, on two joints at −0.5 and 0, each edge of another colour, light and
/// dark in bands; it bends at its middle. In the normalised frame.
inline Asset two_bone_bar() {
  Asset asset;
  asset.name = "bar";
  constexpr int kRings = 21;
  for (int ring = 0; ring < kRings; ++ring) {
    const float z = -0.5f + static_cast<float>(ring) / (kRings - 1);
    for (const auto& [x, y] : {std::pair{-0.12f, -0.05f}, {0.12f, -0.05f}, {0.12f, 0.05f}, {-0.12f, 0.05f}}) {
      asset.mesh.vertices.emplace_back(x, y, z);
      const float band = ring % 6 < 3 ? 0.9f : 0.4f;
      asset.mesh.colors.emplace_back(band, x > 0.0f ? 0.8f * band : 0.2f, y > 0.0f ? 0.9f : 0.3f, 1.0f);
      const float upper = std::min(1.0f, std::max(0.0f, 0.5f + z / 0.1f));
      std::vector<Influence> row;
      if (upper < 1.0f) row.push_back({0, 1.0f - upper});
      if (upper > 0.0f) row.push_back({1, upper});
      asset.skin.append_row(row);
    }
  }
  const auto face = [&](int a, int b, int c) { asset.mesh.faces.push_back({a, b, c}); };
  for (int ring = 0; ring + 1 < kRings; ++ring) {
    for (int k = 0; k < 4; ++k) {
      const int a = 4 * ring + k, b = 4 * ring + (k + 1) % 4, c = a + 4, d = b + 4;
      face(a, b, d);
      face(a, d, c);
    }
  }
  face(0, 2, 1);
  face(0, 3, 2);
  const int top = 4 * (kRings - 1);
  face(top, top + 1, top + 2);
  face(top, top + 2, top + 3);
  asset.skeleton = skeleton_from_joints({{0, 0, -0.5}, {0, 0, 0}}, {-1, 0}, {"lower", "upper"});
  return asset;
}

}  // namespace anigen::test
