#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::io {

/// A material of a library: what the project keeps of one.
struct MtlMaterial {
  std::string name;
  Eigen::Vector4f color = Eigen::Vector4f::Ones();  ///< Kd, and d or 1 − Tr
  std::string texture;                              ///< file that map_Kd names, as written; empty: none
};

/// Materials of an MTL text, in its order; keywords of light that is not kept are ignored, colours out of [0, 1] and
/// opacities of 0 do not count. @param file only for the message @throws InputError naming the line
std::vector<MtlMaterial> parse_mtl(const std::string& text, const std::string& file);

/// A mesh and the materials that its faces name.
struct PaintedMesh {
  Mesh mesh;
  std::vector<Material> materials;  ///< in the order of their first use; a texture replaces the colour
  std::vector<EncodedImage> images;
  std::vector<std::string> notes;  ///< libraries, materials and textures that are missing or cannot be read
};

/// read_obj(), with materials and textures of the libraries (`mtllib`) that lie in or below the file's folder. What is
/// missing is noted; faces of an unknown material are white. @throws InputError as read_obj()
PaintedMesh read_painted_obj(const std::filesystem::path& path);

}  // namespace anigen::io
