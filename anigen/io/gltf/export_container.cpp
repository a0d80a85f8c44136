#include "anigen/io/gltf/export_container.h"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <limits>

#include "anigen/core/base64.h"
#include "anigen/core/error.h"

namespace anigen::io {
namespace {

void append_uint32(std::string& bytes, std::uint64_t value) {
  for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<char>((value >> shift) & 0xFF));
}

}  // namespace

bool is_binary_extension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (extension == ".glb") return true;
  if (extension == ".gltf") return false;
  throw InputError(path.string(), "", "a glTF file must be called .glb or .gltf");
}

std::string glb_bytes(const GltfDocument& document, const std::string& file) {
  constexpr std::uint64_t kHeader = 12, kChunkHeader = 8;
  std::string text = document.json_text("");
  text.append((4 - text.size() % 4) % 4, ' ');
  const std::string& binary = document.binary();
  const std::uint64_t total = kHeader + kChunkHeader + text.size() + kChunkHeader + binary.size();
  if (total > std::numeric_limits<std::uint32_t>::max()) {
    throw NotSupportedError(file, "", "a .glb of " + std::to_string(total) + " bytes (the format ends at 4 GiB)");
  }
  std::string bytes;
  bytes.reserve(static_cast<std::size_t>(total));
  bytes += "glTF";
  append_uint32(bytes, 2);
  append_uint32(bytes, total);
  append_uint32(bytes, text.size());
  bytes += "JSON";
  bytes += text;
  append_uint32(bytes, binary.size());
  bytes.append("BIN\0", 4);
  bytes += binary;
  return bytes;
}

std::string embedded_gltf_bytes(const GltfDocument& document) {
  return document.json_text("data:application/octet-stream;base64," + base64(document.binary()));
}

}  // namespace anigen::io
