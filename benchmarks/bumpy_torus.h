#pragma once
#include <cmath>

#include "anigen/asset/mesh.h"

/// A closed surface with bumps, rings × segments vertices. @param gather > 1 crowds the vertices together: towards one
/// side of every ring and towards one ring
inline anigen::Mesh bumpy_torus(int rings, int segments, double gather = 1.0) {
  constexpr double kTwoPi = 6.283185307179586;
  anigen::Mesh mesh;
  for (int r = 0; r < rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      const double u = kTwoPi * std::pow(static_cast<double>(r) / rings, gather);
      const double v = kTwoPi * std::pow(static_cast<double>(s) / segments, gather);
      const double tube = 0.13 + 0.015 * std::sin(9 * u) * std::cos(7 * v), radius = 0.35 + tube * std::cos(v);
      mesh.vertices.emplace_back(static_cast<float>(radius * std::cos(u)), static_cast<float>(radius * std::sin(u)),
                                 static_cast<float>(tube * std::sin(v)));
    }
  }
  const auto at = [&](int r, int s) { return (r % rings) * segments + s % segments; };
  for (int r = 0; r < rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      mesh.faces.push_back({at(r, s), at(r + 1, s), at(r + 1, s + 1)});
      mesh.faces.push_back({at(r, s), at(r + 1, s + 1), at(r, s + 1)});
    }
  }
  return mesh;
}
