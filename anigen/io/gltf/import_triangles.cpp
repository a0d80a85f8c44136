#include "anigen/io/gltf/import_triangles.h"

namespace anigen::io::gltf_import {

TriangleList triangulate(int mode, const std::vector<std::uint32_t>& indices) {
  TriangleList result;
  const auto add = [&](std::size_t a, std::size_t b, std::size_t c) {
    const Triangle face = {static_cast<std::int32_t>(indices[a]), static_cast<std::int32_t>(indices[b]),
                           static_cast<std::int32_t>(indices[c])};
    if (face[0] == face[1] || face[1] == face[2] || face[2] == face[0])
      ++result.degenerate;
    else
      result.faces.push_back(face);
  };
  const std::size_t count = indices.size();
  if (mode == 4) {
    result.faces.reserve(count / 3);
    for (std::size_t i = 0; i + 3 <= count; i += 3) add(i, i + 1, i + 2);
    result.left_over = count % 3;
  } else {
    result.left_over = count < 3 ? count : 0;
    for (std::size_t i = 0; i + 3 <= count; ++i) {
      if (mode == 5)
        add(i, i + 1 + i % 2, i + 2 - i % 2);  // every second triangle of a strip is turned around
      else
        add(i + 1, i + 2, 0);
    }
  }
  return result;
}

}  // namespace anigen::io::gltf_import
