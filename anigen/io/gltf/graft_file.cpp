#include "anigen/io/gltf/graft_file.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <system_error>
#include <utility>

#include "anigen/core/hash.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"

namespace anigen::io::gltf_import {

namespace {

constexpr int kVertexAttributes = 34962;  // ARRAY_BUFFER

std::string data_uri_of(std::string_view bytes) {
  return "\"data:application/octet-stream;base64," + base64(bytes) + "\"";
}

// By the first bytes, since a view has no name that tells; else by the extension of the file.
std::string media_type_of(std::string_view bytes, const std::string& uri) {
  if (const char* known = picture_mime_type(bytes)) return known;
  if (bytes.substr(0, 4) == "RIFF" && bytes.size() > 12 && bytes.substr(8, 4) == "WEBP") return "image/webp";
  if (bytes.substr(0, 12) == "\xABKTX 20\xBB\r\n\x1A\n") return "image/ktx2";
  const std::string extension = lower_case(std::filesystem::path(uri).extension().string());
  return "image/" + (extension.size() > 1 ? extension.substr(1) : "png");
}

}  // namespace

GraftFile::GraftFile(const Container& container, const ImportOptions& options)
    : container_(container),
      root_(container.json, container.file),
      text_(container.text),
      max_bytes_(options.max_file_bytes) {
  if (root_.size_of("buffers") == 0) return;
  const JsonPlace first = root_.at("buffers")[0];
  if (const auto uri = first.find("uri")) {
    binary_ = read_uri(uri->string(), container.folder, container.file, uri->pointer(), max_bytes_);
  } else if (container.has_binary) {
    binary_ = container.binary;
  } else {
    first.not_supported("adding to a file whose first buffer has no bytes of its own");
  }
}

std::size_t GraftFile::count(const std::string& array) const {
  const auto added = added_.find(array);
  return root_.size_of(array.c_str()) + (added == added_.end() ? 0 : added->second.size());
}

JsonText::Span GraftFile::original(const std::string& array, std::size_t index) {
  const auto [known, is_new] = originals_.try_emplace(array);
  if (is_new) {
    if (const auto list = text_.find(text_.root(), array)) known->second = text_.elements(*list);
  }
  return known->second.at(index);
}

int GraftFile::add(const std::string& array, std::string object) {
  added_[array].push_back(std::move(object));
  return static_cast<int>(count(array)) - 1;
}

void GraftFile::set_array(const std::string& array, const std::vector<std::string>& objects) {
  text_.set(text_.root(), array, "[" + joined(objects, ",") + "]");
}

int GraftFile::add_view(std::string_view bytes, bool vertex_data) {
  binary_.append((4 - binary_.size() % 4) % 4, '\0');
  Json view = {{"buffer", 0}, {"byteOffset", binary_.size()}, {"byteLength", bytes.size()}};
  if (vertex_data) view["target"] = kVertexAttributes;
  binary_ += bytes;
  return add("bufferViews", view.dump());
}

int GraftFile::add_accessor(int view, Component component, std::size_t count, const char* type) {
  const Json accessor = {
      {"bufferView", view}, {"componentType", static_cast<int>(component)}, {"count", count}, {"type", type}};
  return add("accessors", accessor.dump());
}

int GraftFile::add_numbers_accessor(int view, const std::vector<float>& numbers, std::size_t first, std::size_t count,
                                    std::size_t width) {
  Json accessor = {{"bufferView", view},
                   {"byteOffset", sizeof(float) * first},
                   {"componentType", static_cast<int>(Component::kF32)},
                   {"count", count},
                   {"type", width == 1   ? "SCALAR"
                            : width == 3 ? "VEC3"
                                         : "VEC4"}};
  if (width == 1) {
    const auto begin = numbers.begin() + static_cast<std::ptrdiff_t>(first);
    const auto [low, high] = std::minmax_element(begin, begin + static_cast<std::ptrdiff_t>(count));
    accessor["min"] = Json::array({*low});
    accessor["max"] = Json::array({*high});
  }
  return add("accessors", accessor.dump());
}

void GraftFile::embed_files(Notes& notes) {
  const std::size_t buffers = root_.size_of("buffers"), images = root_.size_of("images");
  for (std::size_t i = 1; i < buffers; ++i) {
    const auto uri = root_.at("buffers")[i].find("uri");
    if (!uri || is_data_uri(uri->string())) continue;
    const std::string bytes = read_uri(uri->string(), container_.folder, container_.file, uri->pointer(), max_bytes_);
    text_.set(original("buffers", i), "uri", data_uri_of(bytes));
  }
  for (std::size_t i = 0; i < images; ++i) {
    const JsonPlace image = root_.at("images")[i];
    const auto place = image.find("uri");
    const std::string uri = place ? place->string() : "";
    if (uri.empty() || is_data_uri(uri)) continue;
    std::error_code error;
    if (!std::filesystem::exists(path_of_uri(uri, container_.folder, container_.file, place->pointer()), error)) {
      notes.add("missing_image", "image '" + uri.substr(0, 80) + "' is not there: the copy still names it");
      continue;
    }
    const std::string bytes = read_uri(uri, container_.folder, container_.file, place->pointer(), max_bytes_);
    std::string members = "\"bufferView\":" + std::to_string(add_view(bytes, false));
    if (!image.find("mimeType")) members += ",\"mimeType\":" + Json(media_type_of(bytes, uri)).dump();
    text_.replace_member(original("images", i), "uri", members);
  }
}

void GraftFile::set_first_buffer(bool binary) {
  const std::string length = std::to_string(binary_.size());
  if (root_.size_of("buffers") == 0) {
    if (binary_.empty()) return;
    set_array("buffers", {"{\"byteLength\":" + length + (binary ? "}" : ",\"uri\":" + data_uri_of(binary_) + "}")});
    return;
  }
  const JsonText::Span first = original("buffers", 0);
  text_.set(first, "byteLength", length);
  if (!binary)
    text_.set(first, "uri", data_uri_of(binary_));
  else if (root_.at("buffers")[0].find("uri"))
    text_.erase(first, "uri");
}

std::string GraftFile::bytes(bool binary) {
  binary_.append((4 - binary_.size() % 4) % 4, '\0');
  set_first_buffer(binary);
  for (const auto& [array, objects] : added_) {
    if (const auto list = text_.find(text_.root(), array))
      text_.append(*list, objects);
    else
      set_array(array, objects);
  }
  return binary ? glb_bytes(text_.edited(), binary_, container_.file, container_.further_chunks) : text_.edited();
}

void GraftFile::add_children(std::size_t node, const std::vector<std::string>& children) {
  const JsonText::Span parent = original("nodes", node);
  if (const auto known = text_.find(parent, "children")) {
    text_.append(*known, children);
  } else {
    text_.set(parent, "children", "[" + joined(children, ",", [](const std::string& child) { return child; }) + "]");
  }
}

void GraftFile::add_extensions(const Json& members) {
  // Names come from foreign files and need not be UTF-8, which JSON demands.
  const auto text_of = [](const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); };
  if (const auto known = text_.find(text_.root(), "extensions")) {
    for (const auto& [name, member] : members.items()) text_.set(*known, name, text_of(member));
  } else {
    text_.set(text_.root(), "extensions", text_of(members));
  }
  const Json used = json().value("extensionsUsed", Json::array());
  std::vector<std::string> names;
  for (const auto& [name, member] : members.items()) {
    if (std::find(used.begin(), used.end(), Json(name)) == used.end()) names.push_back(text_of(Json(name)));
  }
  const auto list = text_.find(text_.root(), "extensionsUsed");
  if (list && !names.empty()) text_.append(*list, names);
  if (!list)
    text_.set(text_.root(), "extensionsUsed",
              "[" + joined(names, ",", [](const std::string& name) { return name; }) + "]");
}

}  // namespace anigen::io::gltf_import
