#include "anigen/geometry/mesh_check.h"

#include "anigen/core/error.h"

namespace anigen::geometry {

void check_mesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                const std::string& file, const std::string& array) {
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    // Written so that NaN fails too.
    if (!(vertices[v].cwiseAbs().maxCoeff() <= kLargestCoordinate) || !vertices[v].allFinite()) {
      throw InputError(file, array + ".vertices[" + std::to_string(v) + "]",
                       "the position is not finite or larger than 1e15");
    }
  }
  const auto count = static_cast<std::int64_t>(vertices.size());
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (const std::int32_t index : faces[f]) {
      if (index < 0 || index >= count) {
        throw InputError(
            file, array + ".faces[" + std::to_string(f) + "]",
            "vertex index " + std::to_string(index) + " is outside the " + std::to_string(count) + " vertices");
      }
    }
  }
}

}  // namespace anigen::geometry
