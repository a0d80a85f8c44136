#include "tests/io/gltf/gltf_import_builder.h"

#include <cstring>
#include <fstream>

namespace anigen::test {
namespace {

std::string base64(const std::string& bytes) {
  const char* alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string result;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k)
      group = group << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    for (std::size_t k = 0; k < 4; ++k) result += i + k > bytes.size() ? '=' : alphabet[group >> (18 - 6 * k) & 63];
  }
  return result;
}

std::size_t width_of(const std::string& type) {
  if (type == "SCALAR") return 1;
  if (type == "MAT4") return 16;
  return static_cast<std::size_t>(type[3] - '0');
}

void append_u32(std::string& bytes, std::size_t value) {
  for (int shift = 0; shift < 32; shift += 8) bytes += static_cast<char>(value >> shift & 0xFF);
}

}  // namespace

GltfBuilder::GltfBuilder() {
  json = {{"asset", {{"version", "2.0"}}}, {"scene", 0}, {"scenes", Json::array()}, {"nodes", Json::array()}};
  json["bufferViews"] = json["accessors"] = Json::array();
}

int GltfBuilder::view(const std::string& bytes) {
  buffer.resize((buffer.size() + 3) / 4 * 4, '\0');
  json["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", buffer.size()}, {"byteLength", bytes.size()}});
  buffer += bytes;
  return static_cast<int>(json["bufferViews"].size()) - 1;
}

int GltfBuilder::append(const void* data, std::size_t bytes, int component, std::size_t numbers,
                        const std::string& type, bool normalized) {
  const int index = view(std::string(static_cast<const char*>(data), bytes));
  Json accessor = {
      {"bufferView", index}, {"componentType", component}, {"count", numbers / width_of(type)}, {"type", type}};
  if (normalized) accessor["normalized"] = true;
  json["accessors"].push_back(accessor);
  return static_cast<int>(json["accessors"].size()) - 1;
}

int GltfBuilder::floats(const std::vector<float>& values, const std::string& type) {
  return append(values.data(), 4 * values.size(), 5126, values.size(), type, false);
}
int GltfBuilder::u8(const std::vector<std::uint8_t>& values, const std::string& type, bool normalized) {
  return append(values.data(), values.size(), 5121, values.size(), type, normalized);
}
int GltfBuilder::u16(const std::vector<std::uint16_t>& values, const std::string& type, bool normalized) {
  return append(values.data(), 2 * values.size(), 5123, values.size(), type, normalized);
}
int GltfBuilder::i16(const std::vector<std::int16_t>& values, const std::string& type, bool normalized) {
  return append(values.data(), 2 * values.size(), 5122, values.size(), type, normalized);
}
int GltfBuilder::u32(const std::vector<std::uint32_t>& values, const std::string& type) {
  return append(values.data(), 4 * values.size(), 5125, values.size(), type, false);
}

void GltfBuilder::animate(int node, const std::string& path, const std::vector<float>& times,
                          const std::vector<float>& values, const std::string& interpolation) {
  if (!json.contains("animations")) {
    json["animations"] = Json::array();
    json["animations"].push_back({{"name", "move"}, {"channels", Json::array()}, {"samplers", Json::array()}});
  }
  const int input = floats(times, "SCALAR"), output = floats(values, path == "rotation" ? "VEC4" : "VEC3");
  Json& animation = json["animations"][0];
  animation["channels"].push_back(
      {{"sampler", animation["samplers"].size()}, {"target", {{"node", node}, {"path", path}}}});
  animation["samplers"].push_back({{"input", input}, {"output", output}, {"interpolation", interpolation}});
}

std::string GltfBuilder::gltf() const {
  Json full = json;
  if (!full.contains("buffers")) {
    full["buffers"] = Json::array();
    full["buffers"].push_back(
        {{"byteLength", buffer.size()}, {"uri", "data:application/octet-stream;base64," + base64(buffer)}});
  }
  return full.dump();
}

std::string GltfBuilder::glb() const {
  Json full = json;
  if (!full.contains("buffers")) {
    full["buffers"] = Json::array();
    full["buffers"].push_back({{"byteLength", buffer.size()}});
  }
  return glb_of(full.dump(), buffer);
}

void GltfBuilder::save(const std::filesystem::path& path) const {
  write_bytes(path, path.extension() == ".glb" ? glb() : gltf());
}

std::string glb_of(const std::string& json, const std::string& binary) {
  std::string text = json, data = binary;
  text.resize((text.size() + 3) / 4 * 4, ' ');
  data.resize((data.size() + 3) / 4 * 4, '\0');
  std::string bytes = "glTF";
  append_u32(bytes, 2);
  append_u32(bytes, 12 + 8 + text.size() + 8 + data.size());
  append_u32(bytes, text.size());
  bytes += "JSON" + text;
  append_u32(bytes, data.size());
  return bytes + std::string("BIN\0", 4) + data;
}

void write_bytes(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

GltfBuilder flag() {
  GltfBuilder file;
  file.floats({-1, 0, 0, 1, 0, 0, -1, 2, 0, 1, 2, 0}, "VEC3");
  file.u8({0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, "VEC4");
  file.floats({1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, "VEC4");
  file.u16({0, 1, 2, 2, 1, 3}, "SCALAR");
  file.floats({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0,  0, 1,  //
               1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -1, 0, 1},
              "MAT4");
  file.json["scenes"].push_back({{"nodes", {0, 1}}});
  file.json["nodes"].push_back({{"mesh", 0}, {"skin", 0}});
  file.json["nodes"].push_back({{"name", "hip"}, {"children", {2}}});
  file.json["nodes"].push_back({{"name", "knee"}, {"translation", {0, 1, 0}}});
  file.json["skins"] = Json::array();
  file.json["skins"].push_back({{"joints", {1, 2}}, {"inverseBindMatrices", 4}});
  Json primitive = {{"attributes", {{"POSITION", 0}, {"JOINTS_0", 1}, {"WEIGHTS_0", 2}}}, {"indices", 3}};
  file.json["meshes"] = Json::array();
  file.json["meshes"].push_back({{"primitives", Json::array({primitive})}});
  return file;
}

}  // namespace anigen::test
