#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config.h"

namespace anigen::test {

/// Writes small glTF files by hand, good ones and broken ones: the JSON is open, the numbers go into one buffer.
class GltfBuilder {
 public:
  GltfBuilder();

  Json json;
  std::string buffer;

  /// Each appends the numbers to the buffer, with a view and an accessor of its own. @return the accessor
  int floats(const std::vector<float>& values, const std::string& type);
  int u8(const std::vector<std::uint8_t>& values, const std::string& type, bool normalized = false);
  int u16(const std::vector<std::uint16_t>& values, const std::string& type, bool normalized = false);
  int i16(const std::vector<std::int16_t>& values, const std::string& type, bool normalized = false);
  int u32(const std::vector<std::uint32_t>& values, const std::string& type);
  /// Only a view. @return its index
  int view(const std::string& bytes);

  /// Adds an animation channel, in one animation called "move". @param path "translation", "rotation", "scale"
  void animate(int node, const std::string& path, const std::vector<float>& times, const std::vector<float>& values,
               const std::string& interpolation = "LINEAR");

  std::string gltf() const;  ///< with the buffer as a data URI
  std::string glb() const;
  void save(const std::filesystem::path& path) const;  ///< by extension

 private:
  int append(const void* data, std::size_t bytes, int component, std::size_t numbers, const std::string& type,
             bool normalized);
};

std::string glb_of(const std::string& json, const std::string& binary);
void write_bytes(const std::filesystem::path& path, const std::string& bytes);

/// A flag of two triangles on two joints: node 0 shows mesh 0 with skin 0, node 1 is the root joint "hip" at the
/// origin, node 2 its child "knee" at (0, 1, 0). Accessors: 0 POSITION (−1,0,0) (1,0,0) (−1,2,0) (1,2,0), 1 JOINTS_0,
/// 2 WEIGHTS_0 (the lower vertices on the hip, the upper ones on the knee), 3 indices, 4 inverse bind matrices.
GltfBuilder flag();

}  // namespace anigen::test
