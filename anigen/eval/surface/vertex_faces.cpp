#include "anigen/eval/surface/vertex_faces.h"

#include <string>

#include "anigen/core/error.h"

namespace anigen::eval {

VertexFaces::VertexFaces(const Mesh& mesh) : offsets_(mesh.vertices.size() + 1, 0) {
  const auto each_corner = [&](const auto& body) {
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
      const Triangle& face = mesh.faces[f];
      for (std::size_t i = 0; i < 3; ++i) {
        const bool repeated = (i > 0 && face[i] == face[0]) || (i > 1 && face[i] == face[1]);
        if (!repeated) body(f, face[i]);
      }
    }
  };
  each_corner([&](std::size_t face, std::int32_t vertex) {
    if (vertex < 0 || static_cast<std::size_t>(vertex) >= mesh.vertices.size()) {
      throw InputError("", "faces[" + std::to_string(face) + "]", "there is no vertex " + std::to_string(vertex));
    }
    ++offsets_[static_cast<std::size_t>(vertex) + 1];
  });
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) offsets_[v + 1] += offsets_[v];
  faces_.resize(offsets_.back());
  std::vector<std::size_t> next(offsets_.begin(), offsets_.end() - 1);
  each_corner([&](std::size_t face, std::int32_t vertex) {
    faces_[next[static_cast<std::size_t>(vertex)]++] = static_cast<std::int32_t>(face);
  });
}

}  // namespace anigen::eval
