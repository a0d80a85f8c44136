#include "anigen/io/gltf/export_document.h"

#include <algorithm>

namespace anigen::io {
namespace {

template <typename T>
int add_array(GltfDocument& document, const std::vector<T>& values, std::size_t width, ComponentType component,
              ViewTarget target) {
  const int view = document.add_view(values.data(), values.size() * sizeof(T), target);
  return document.add_accessor(view, 0, component, accessor_type(width), values.size() / width);
}

}  // namespace

const char* accessor_type(std::size_t width) {
  switch (width) {
    case 1:
      return "SCALAR";
    case 2:
      return "VEC2";
    case 3:
      return "VEC3";
    case 4:
      return "VEC4";
    default:
      return "MAT4";
  }
}

GltfDocument::GltfDocument() : json(Json::object()) {
  json["asset"] = {{"version", "2.0"}, {"generator", "AniGen in C++"}};
}

int GltfDocument::add_view(const void* data, std::size_t bytes, ViewTarget target) {
  Json view = {{"buffer", 0}, {"byteOffset", binary_.size()}, {"byteLength", bytes}};
  if (target != ViewTarget::kNone) view["target"] = static_cast<int>(target);
  if (bytes > 0) binary_.append(static_cast<const char*>(data), bytes);
  binary_.append((4 - binary_.size() % 4) % 4, '\0');
  views_.push_back(std::move(view));
  return static_cast<int>(views_.size()) - 1;
}

int GltfDocument::add_accessor(int view, std::size_t byte_offset, ComponentType component, const char* type,
                               std::size_t count) {
  Json accessor = {{"bufferView", view}};
  if (byte_offset > 0) accessor["byteOffset"] = byte_offset;
  accessor["componentType"] = static_cast<int>(component);
  accessor["count"] = count;
  accessor["type"] = type;
  accessors_.push_back(std::move(accessor));
  return static_cast<int>(accessors_.size()) - 1;
}

void GltfDocument::set_bounds(int accessor, const std::vector<float>& values, std::size_t width) {
  std::vector<double> low(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(width));
  std::vector<double> high = low;
  for (std::size_t i = width; i < values.size(); ++i) {
    low[i % width] = std::min<double>(low[i % width], values[i]);
    high[i % width] = std::max<double>(high[i % width], values[i]);
  }
  accessors_[static_cast<std::size_t>(accessor)]["min"] = low;
  accessors_[static_cast<std::size_t>(accessor)]["max"] = high;
}

int GltfDocument::add_floats(const std::vector<float>& values, std::size_t width, ViewTarget target) {
  return add_array(*this, values, width, ComponentType::kFloat, target);
}

int GltfDocument::add_uint8(const std::vector<std::uint8_t>& values, std::size_t width, ViewTarget target) {
  return add_array(*this, values, width, ComponentType::kUint8, target);
}

int GltfDocument::add_uint16(const std::vector<std::uint16_t>& values, std::size_t width, ViewTarget target) {
  return add_array(*this, values, width, ComponentType::kUint16, target);
}

int GltfDocument::add_uint32(const std::vector<std::uint32_t>& values, std::size_t width, ViewTarget target) {
  return add_array(*this, values, width, ComponentType::kUint32, target);
}

std::string GltfDocument::json_text(const std::string& buffer_uri) const {
  Json whole = json;
  whole["accessors"] = accessors_;
  whole["bufferViews"] = views_;
  Json buffer = {{"byteLength", binary_.size()}};
  if (!buffer_uri.empty()) buffer["uri"] = buffer_uri;
  whole["buffers"] = Json::array({std::move(buffer)});
  // Names come from foreign files and need not be UTF-8, which JSON demands.
  return whole.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace anigen::io
