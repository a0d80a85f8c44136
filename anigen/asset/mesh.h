#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace anigen {

using Triangle = std::array<std::int32_t, 3>;

/// An encoded picture as it came (PNG or JPEG bytes), kept so that export does not re-compress it.
struct EncodedImage {
  std::string name;
  std::string mime_type;  ///< "image/png" or "image/jpeg"
  std::vector<std::uint8_t> bytes;
};

/// What the project keeps of a glTF material: base colour only.
struct Material {
  std::string name;
  Eigen::Vector4f base_color = Eigen::Vector4f::Ones();  ///< linear RGBA factor
  int image = -1;  ///< index into Asset::images of the sRGB base colour texture, or -1
  bool double_sided = true;
};

/// Triangle mesh. Vertices are those of the file (split at texture seams), in order; every per-vertex array is
/// empty or as long as `vertices`.
struct Mesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Triangle> faces;
  std::vector<Eigen::Vector3f> normals;      ///< unit length, from the file
  std::vector<Eigen::Vector2f> uvs;          ///< glTF convention: origin at the top left
  std::vector<Eigen::Vector4f> colors;       ///< linear RGBA in [0, 1], multiplied with the material
  std::vector<std::int32_t> face_materials;  ///< per face, index into Asset::materials or -1; empty: all -1
};

struct Box {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(1e300);
  Eigen::Vector3d high = Eigen::Vector3d::Constant(-1e300);
  bool empty() const { return low.x() > high.x(); }
  Eigen::Vector3d center() const { return 0.5 * (low + high); }
  double diagonal() const { return empty() ? 0.0 : (high - low).norm(); }
  double longest_side() const { return empty() ? 0.0 : (high - low).maxCoeff(); }
  void extend(const Eigen::Vector3d& p) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
};

Box bounding_box(const std::vector<Eigen::Vector3f>& points);

/// Area-weighted vertex normals [V], unit length; (0, 0, 1) where no face gives one.
std::vector<Eigen::Vector3f> vertex_normals(const std::vector<Eigen::Vector3f>& vertices,
                                            const std::vector<Triangle>& faces);

}  // namespace anigen
