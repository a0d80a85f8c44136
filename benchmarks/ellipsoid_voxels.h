#pragma once
#include <cmath>
#include <vector>

#include "anigen/geometry/voxel_grid.h"

namespace anigen::benchmarks {

/// Voxels of an ellipsoid at `resolution`³: all inside it, or a shell of two voxels' thickness.
/// @param scale its half-axis along x and y, in units of the grid
inline std::vector<geometry::Voxel> ellipsoid_voxels(int resolution, double scale, bool shell) {
  std::vector<geometry::Voxel> voxels;
  const double thickness = 2.0 / resolution;
  for (int x = 0; x < resolution; ++x) {
    for (int y = 0; y < resolution; ++y) {
      for (int z = 0; z < resolution; ++z) {
        const double p = (x + 0.5) / resolution - 0.5, q = (y + 0.5) / resolution - 0.5,
                     r = (z + 0.5) / resolution - 0.5;
        const double radius = std::sqrt(p * p + q * q + 1.2 * r * r);
        if (radius > scale || (shell && radius < scale - thickness)) continue;
        voxels.push_back({x, y, z});
      }
    }
  }
  return voxels;
}

}  // namespace anigen::benchmarks
