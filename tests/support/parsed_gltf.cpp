#include "tests/support/parsed_gltf.h"

#include <cstdint>
#include <cstring>
#include <stdexcept>

#include "anigen/core/files.h"

namespace anigen::test {
namespace {

template <typename T>
T value_at(const std::string& bytes, std::size_t offset) {
  T value;
  if (offset + sizeof(T) > bytes.size()) throw std::runtime_error("read beyond the end");
  std::memcpy(&value, bytes.data() + offset, sizeof(T));
  return value;
}

double component(const std::string& bytes, std::size_t offset, int type) {
  switch (type) {
    case 5121:
      return value_at<std::uint8_t>(bytes, offset);
    case 5123:
      return value_at<std::uint16_t>(bytes, offset);
    case 5125:
      return value_at<std::uint32_t>(bytes, offset);
    case 5126:
      return value_at<float>(bytes, offset);
    default:
      throw std::runtime_error("unexpected component type");
  }
}

}  // namespace

ParsedGltf::ParsedGltf(const std::filesystem::path& path) {
  const std::string bytes = read_file(path);
  file_size = bytes.size();
  if (bytes.substr(0, 4) != "glTF" || value_at<std::uint32_t>(bytes, 4) != 2) throw std::runtime_error("not a .glb");
  if (value_at<std::uint32_t>(bytes, 8) != bytes.size()) throw std::runtime_error("wrong length in the header");
  const auto json_length = value_at<std::uint32_t>(bytes, 12);
  if (bytes.substr(16, 4) != "JSON" || json_length % 4 != 0) throw std::runtime_error("wrong JSON chunk");
  json = Json::parse(bytes.substr(20, json_length));
  const auto binary_length = value_at<std::uint32_t>(bytes, 20 + json_length);
  if (bytes.substr(24 + json_length, 4) != std::string("BIN\0", 4)) throw std::runtime_error("wrong binary chunk");
  binary = bytes.substr(28 + json_length);
  if (binary.size() != binary_length || binary_length % 4 != 0) throw std::runtime_error("wrong binary chunk length");
}

std::vector<double> ParsedGltf::numbers(std::size_t accessor) const {
  const Json& a = json.at("accessors").at(accessor);
  const Json& view = json.at("bufferViews").at(a.at("bufferView").get<std::size_t>());
  const std::string type = a.at("type");
  const std::size_t width = type == "SCALAR" ? 1 : type == "MAT4" ? 16 : static_cast<std::size_t>(type.back() - '0');
  const int component_type = a.at("componentType");
  const std::size_t size = component_type == 5121 ? 1 : component_type == 5123 ? 2 : 4;
  const std::size_t start = view.at("byteOffset").get<std::size_t>() + a.value("byteOffset", std::size_t{0});
  if (start % 4 != 0) throw std::runtime_error("accessor not aligned to 4 bytes");
  std::vector<double> values(width * a.at("count").get<std::size_t>());
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = component(binary, start + i * size, component_type);
  return values;
}

std::vector<double> ParsedGltf::attribute(const std::string& name, std::size_t primitive) const {
  return numbers(json.at("meshes").at(0).at("primitives").at(primitive).at("attributes").at(name).get<std::size_t>());
}

std::string ParsedGltf::image(std::size_t i) const {
  const Json& view = json.at("bufferViews").at(json.at("images").at(i).at("bufferView").get<std::size_t>());
  return binary.substr(view.at("byteOffset").get<std::size_t>(), view.at("byteLength").get<std::size_t>());
}

}  // namespace anigen::test
