#include "anigen/io/gltf/import_container.h"

#include <cstring>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/gltf/import_uri.h"

namespace anigen::io::gltf_import {
namespace {

constexpr std::uint32_t kJsonChunk = 0x4E4F534A;
constexpr std::uint32_t kBinaryChunk = 0x004E4942;

std::uint32_t u32_at(std::string_view bytes, std::size_t offset) {
  std::uint32_t value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);  // GLB and every host we support are little-endian
  return value;
}

std::string byte(std::size_t offset) { return "byte " + std::to_string(offset); }

// The JSON chunk's text; sets `binary`. GLB: 12 bytes of header, then chunks of length, type, data.
std::string_view split_glb(std::string_view bytes, Container& container) {
  const std::string& file = container.file;
  if (bytes.size() < 20) throw InputError(file, byte(bytes.size()), "GLB ends inside its header: truncated file");
  const std::uint32_t version = u32_at(bytes, 4);
  if (version != 2) throw NotSupportedError(file, byte(4), "GLB version " + std::to_string(version));
  const std::size_t length = u32_at(bytes, 8);
  if (length > bytes.size() || length < 20) {
    throw InputError(file, byte(8),
                     "GLB header says " + std::to_string(length) + " bytes, the file has " +
                         std::to_string(bytes.size()) + ": truncated or damaged file");
  }
  bytes = bytes.substr(0, length);
  std::string_view json;
  for (std::size_t offset = 12, chunk = 0; offset < length; ++chunk) {
    if (length - offset < 8) {
      // Some writers pad the end of the file.
      if (chunk > 0) break;
      throw InputError(file, byte(offset), "GLB ends inside a chunk header: truncated file");
    }
    const std::size_t size = u32_at(bytes, offset);
    const std::uint32_t type = u32_at(bytes, offset + 4);
    offset += 8;
    if (size > length - offset) {
      throw InputError(
          file, byte(offset - 8),
          "GLB chunk of " + std::to_string(size) + " bytes, only " + std::to_string(length - offset) + " are left");
    }
    if (chunk == 0 && type != kJsonChunk) throw InputError(file, byte(offset - 4), "the first GLB chunk is not JSON");
    if (chunk == 0) json = bytes.substr(offset, size);
    if (chunk > 0 && type == kBinaryChunk && !container.has_binary) {
      container.binary = bytes.substr(offset, size);
      container.has_binary = true;
    }
    offset += size;
  }
  return json;
}

}  // namespace

void read_container(const std::filesystem::path& path, const ImportOptions& options, Container& container) {
  container.file = path.string();
  container.folder = path.parent_path();
  container.bytes = read_file(path, options.max_file_bytes);
  const std::string& bytes = container.bytes;
  if (bytes.empty()) throw InputError(container.file, "byte 0", "the file is empty");
  if (is_git_lfs_pointer(bytes)) {
    throw InputError(container.file, "byte 0", "a Git LFS pointer, not the file itself: run 'git lfs pull'");
  }
  const bool binary = bytes.compare(0, 4, "glTF") == 0;
  const std::string_view text = binary ? split_glb(bytes, container) : std::string_view(bytes);
  if (!binary) {
    const std::size_t first = text.find_first_not_of("\xEF\xBB\xBF \t\r\n");
    if (first == std::string_view::npos || text[first] != '{')
      throw InputError(container.file, "byte 0", "neither a GLB nor a JSON object: not a glTF file");
  }
  container.json = parse_json(text, container.file, JsonLimits{options.max_json_depth});
  if (!binary) std::string().swap(container.bytes);
}

}  // namespace anigen::io::gltf_import
