#include <algorithm>

#include "anigen/io/gltf/import_meshopt.h"

#include "anigen/io/gltf/import_parse.h"
#include "anigen/io/gltf/import_uri.h"

namespace anigen::io::gltf_import {
namespace {

constexpr const char* kMeshopt = "EXT_meshopt_compression";

struct Buffer {
  std::string_view bytes;
  bool is_placeholder = false;  // the fallback of a compressed file, which need not exist
};

std::optional<JsonPlace> extension(const JsonPlace& place, const char* name) {
  const auto extensions = place.find("extensions");
  return extensions ? extensions->find(name) : std::nullopt;
}

// Bytes that all buffers and decoded views together may take: a small file must not blow up to any size.
class Budget {
 public:
  explicit Budget(std::uintmax_t bytes) : left_(bytes) {}
  void take(std::uintmax_t bytes, const JsonPlace& place) {
    if (bytes > left_) place.fail("all buffers together exceed the limit of the importer");
    left_ -= bytes;
  }

 private:
  std::uintmax_t left_;
};

Buffer read_buffer(const JsonPlace& place, std::size_t index, const Container& container, const ImportOptions& options,
                   Budget& budget, Document& document) {
  const std::uint64_t length = place.at("byteLength").integer(0, kMostBufferBytes);
  Buffer buffer;
  if (const auto uri = place.find("uri")) {
    Resource resource =
        read_uri(uri->string(), container.folder, container.file, uri->pointer(), options.max_file_bytes);
    budget.take(resource.bytes.size(), place);
    document.storage.push_back(std::make_unique<std::string>(std::move(resource.bytes)));
    buffer.bytes = *document.storage.back();
  } else if (index == 0 && container.has_binary) {
    buffer.bytes = container.binary;
  } else if (extension(place, kMeshopt)) {
    buffer.is_placeholder = true;
    return buffer;
  } else {
    place.fail("the buffer has no uri, and there is no binary chunk for it");
  }
  if (buffer.bytes.size() < length) {
    place.at("byteLength")
        .fail("the buffer should have " + std::to_string(length) + " bytes but has only " +
              std::to_string(buffer.bytes.size()) + ": truncated data");
  }
  buffer.bytes = buffer.bytes.substr(0, length);
  return buffer;
}

// The bytes that "buffer", "byteOffset", "byteLength" of a view (or of its compressed form) name.
std::string_view cut(const JsonPlace& place, const std::vector<Buffer>& buffers) {
  const int index = place.index("buffer", buffers.size(), "buffer");
  const Buffer& buffer = buffers[static_cast<std::size_t>(index)];
  if (buffer.is_placeholder) place.at("buffer").fail("the buffer has no data");
  const std::uint64_t offset = place.integer_or("byteOffset", 0, kMostBufferBytes);
  const std::uint64_t length = place.at("byteLength").integer(0, kMostBufferBytes);
  if (offset + length > buffer.bytes.size()) {
    place.fail("bytes " + std::to_string(offset) + " to " + std::to_string(offset + length) + " lie outside buffer " +
               std::to_string(index) + " of " + std::to_string(buffer.bytes.size()) + " bytes");
  }
  return buffer.bytes.substr(offset, length);
}

}  // namespace

void parse_buffers(const JsonPlace& root, const Container& container, const ImportOptions& options, Document& document,
                   Notes& notes) {
  Budget budget(options.max_file_bytes < kMostBufferBytes ? 4 * options.max_file_bytes : options.max_file_bytes);
  std::vector<Buffer> buffers;
  if (const auto list = root.find("buffers")) {
    for (std::size_t i = 0; i < list->size(); ++i)
      buffers.push_back(read_buffer((*list)[i], i, container, options, budget, document));
  }
  const auto list = root.find("bufferViews");
  for (std::size_t i = 0; list && i < list->size(); ++i) {
    const JsonPlace place = (*list)[i];
    BufferView view;
    view.stride = place.integer_or("byteStride", 0, 1 << 16);
    if (const auto compressed = extension(place, kMeshopt)) {
      place.index("buffer", buffers.size(), "buffer");
      const std::uint64_t length = place.at("byteLength").integer(1, kMostBufferBytes);
      budget.take(length, place);
      document.storage.push_back(
          std::make_unique<std::string>(decode_meshopt(*compressed, cut(*compressed, buffers), length)));
      view.bytes = *document.storage.back();
      notes.tally("decoded_meshopt", "buffer views decoded from EXT_meshopt_compression");
    } else {
      view.bytes = cut(place, buffers);
    }
    document.views.push_back(view);
  }
}

}  // namespace anigen::io::gltf_import
