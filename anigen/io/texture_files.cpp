#include "anigen/io/texture_files.h"

#include <algorithm>
#include <cstdint>
#include <string_view>
#include <system_error>

#include "anigen/core/files.h"
#include "anigen/io/foreign_image.h"

namespace anigen::io {

namespace {

constexpr std::uintmax_t kMostTextureBytes = std::uintmax_t{256} << 20;

bool begins_with(std::string_view bytes, std::string_view magic) { return bytes.substr(0, magic.size()) == magic; }

}  // namespace

std::filesystem::path find_named_file(std::string named, const std::filesystem::path& folder) {
  namespace fs = std::filesystem;
  std::replace(named.begin(), named.end(), '\\', '/');
  const fs::path given = fs::path(named).lexically_normal();
  const fs::path name = given.filename();
  const bool inside =
      given.is_relative() && !given.empty() && *given.begin() != ".." && named.find(':') == std::string::npos;
  for (const fs::path& place : {inside ? given : name, name, fs::path("textures") / name}) {
    std::error_code error;
    if (!place.empty() && fs::is_regular_file(folder / place, error)) return place;
  }
  return name;
}

EncodedImage read_texture(const std::filesystem::path& file) {
  using std::string_view_literals::operator""sv;
  const std::string bytes = read_file(file, kMostTextureBytes);
  EncodedImage image{file.stem().string(), "image/png", {bytes.begin(), bytes.end()}};
  if (begins_with(bytes, "\x89PNG\r\n\x1a\n"sv)) return image;
  if (begins_with(bytes, "\xFF\xD8\xFF"sv)) {
    image.mime_type = "image/jpeg";
  } else {
    image.bytes = encode_png(decode_foreign_image(image.bytes, file.string()));
  }
  return image;
}

}  // namespace anigen::io
