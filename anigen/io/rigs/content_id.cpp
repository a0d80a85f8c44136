#include "anigen/io/rigs/content_id.h"

#include <algorithm>

#include "anigen/core/atomic_file.h"
#include "anigen/core/json.h"
#include "anigen/core/sha256.h"
#include "anigen/io/gltf.h"
#include "anigen/io/gltf/import_uri.h"

namespace anigen::io {

std::string content_id(NamedArrays arrays) {
  std::sort(arrays.begin(), arrays.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  Sha256 digest;
  for (const auto& [name, array] : arrays) {
    std::string header = name + '\0' + name_of(array.dtype);
    for (const std::int64_t size : array.shape) header += ' ' + std::to_string(size);
    digest.update(header + '\0');
    digest.update({reinterpret_cast<const char*>(array.bytes.data()), array.bytes.size()});
  }
  return digest.finish();
}

std::string gltf_content_id(const std::filesystem::path& file) {
  const ImportOptions limits;
  const std::string text = read_file(file, limits.max_file_bytes);
  Sha256 digest;
  digest.update(text);
  const Json json = parse_json(text, file.string(), JsonLimits{limits.max_json_depth});
  const auto buffers = json.is_object() ? json.find("buffers") : json.end();
  if (buffers == json.end() || !buffers->is_array()) return digest.finish();
  for (std::size_t i = 0; i < buffers->size(); ++i) {
    const Json& buffer = (*buffers)[i];
    if (!buffer.is_object() || !buffer.contains("uri") || !buffer["uri"].is_string()) continue;
    const std::string uri = buffer["uri"].get<std::string>();
    if (uri.rfind("data:", 0) == 0) continue;
    const std::string pointer = "/buffers/" + std::to_string(i) + "/uri";
    const std::filesystem::path buffered = gltf_import::path_of_uri(uri, file.parent_path(), file.string(), pointer);
    digest.update(read_file(buffered, limits.max_file_bytes));
  }
  return digest.finish();
}

}  // namespace anigen::io
