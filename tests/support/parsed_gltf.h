#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config.h"

namespace anigen::test {

/// A written .glb taken apart without the importer, so that export is judged by the format's text alone.
struct ParsedGltf {
  explicit ParsedGltf(const std::filesystem::path& path);

  Json json;
  std::string binary;
  std::size_t file_size = 0;

  /// The numbers of an accessor, whatever its component type, in order.
  std::vector<double> numbers(std::size_t accessor) const;
  std::vector<double> attribute(const std::string& name, std::size_t primitive = 0) const;
  /// The bytes of image i.
  std::string image(std::size_t i) const;
};

}  // namespace anigen::test
