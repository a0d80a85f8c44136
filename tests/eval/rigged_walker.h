#pragma once
#include <algorithm>
#include <cmath>

#include "tests/metrics/align_shapes.h"

namespace anigen::test {

/// walker() with seven joints, one per part, and weights that blend the two nearest of them.
inline io::RiggedShape rigged_walker(int rings = 8) {
  io::RiggedShape shape = rigged(walker(rings));
  shape.id = "walker";
  shape.joints.positions = {{0, 0, 0.1},         {0, -0.02, 0.5},     {-0.24, -0.12, 0.22}, {0.24, 0.03, 0.1},
                            {-0.09, 0.05, -0.2}, {0.09, -0.08, -0.2}, {0.09, -0.1, -0.5}};
  shape.joints.parents = {-1, 0, 0, 0, 0, 0, 5};
  for (const Eigen::Vector3f& vertex : shape.mesh.vertices) {
    std::vector<Influence> row;
    for (std::size_t j = 0; j < shape.joints.size(); ++j) {
      const double distance = (shape.joints.positions[j] - vertex.cast<double>()).norm();
      row.push_back({static_cast<std::int32_t>(j), static_cast<float>(1.0 / (1e-3 + std::pow(distance, 4)))});
    }
    std::sort(row.begin(), row.end(), [](const Influence& a, const Influence& b) { return a.weight > b.weight; });
    row.resize(2);
    shape.skin.append_row(std::move(row));
  }
  return shape;
}

}  // namespace anigen::test
