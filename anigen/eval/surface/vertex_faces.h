#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::eval {

/// The faces around each vertex of a mesh, by index, ascending; a face that names a vertex twice is listed once.
class VertexFaces {
 public:
  /// @throws InputError when a face refers to a vertex that is missing
  explicit VertexFaces(const Mesh& mesh);

  struct Range {
    const std::int32_t *first, *last;
    const std::int32_t* begin() const { return first; }
    const std::int32_t* end() const { return last; }
  };
  /// @pre vertex is one of the mesh
  Range operator[](std::int32_t vertex) const {
    const auto v = static_cast<std::size_t>(vertex);
    return {faces_.data() + offsets_[v], faces_.data() + offsets_[v + 1]};
  }

 private:
  std::vector<std::size_t> offsets_;  // [V + 1]
  std::vector<std::int32_t> faces_;
};

}  // namespace anigen::eval
