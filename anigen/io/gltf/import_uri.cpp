#include "anigen/io/gltf/import_uri.h"

#include <array>
#include <cctype>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"

namespace anigen::io::gltf_import {
namespace {

namespace fs = std::filesystem;

// Error messages quote URIs; data URIs and hostile ones can be long.
std::string quoted(const std::string& uri) {
  std::string result = "'";
  for (const char c : uri.substr(0, 80)) result += std::isprint(static_cast<unsigned char>(c)) != 0 ? c : '?';
  return result + (uri.size() > 80 ? "…'" : "'");
}

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::string percent_decoded(const std::string& text) {
  std::string result;
  result.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    const int high = text[i] == '%' && i + 2 < text.size() ? hex_digit(text[i + 1]) : -1;
    const int low = high >= 0 ? hex_digit(text[i + 2]) : -1;
    if (low >= 0) {
      result += static_cast<char>(16 * high + low);
      i += 2;
    } else {
      result += text[i];
    }
  }
  return result;
}

// RFC 3986: a letter, then letters, digits, '+', '-', '.', up to ':'.
bool has_scheme(const std::string& uri) {
  if (uri.empty() || std::isalpha(static_cast<unsigned char>(uri[0])) == 0) return false;
  for (const char c : uri) {
    if (c == ':') return true;
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '+' && c != '-' && c != '.') return false;
  }
  return false;
}

std::array<std::int8_t, 256> base64_table() {
  std::array<std::int8_t, 256> table{};
  table.fill(-1);
  const std::string alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (std::size_t i = 0; i < alphabet.size(); ++i)
    table[static_cast<unsigned char>(alphabet[i])] = static_cast<std::int8_t>(i);
  table[static_cast<unsigned char>('-')] = 62;  // the URL-safe alphabet, which some exporters use
  table[static_cast<unsigned char>('_')] = 63;
  return table;
}

bool decode_base64(const char* text, std::size_t size, std::string& out) {
  static const std::array<std::int8_t, 256> table = base64_table();
  while (size > 0 && text[size - 1] == '=') --size;
  out.reserve(size / 4 * 3 + 3);
  std::uint32_t bits = 0;
  int count = 0;
  for (std::size_t i = 0; i < size; ++i) {
    const int value = table[static_cast<unsigned char>(text[i])];
    if (value < 0) return false;
    bits = bits << 6 | static_cast<std::uint32_t>(value);
    count += 6;
    if (count >= 8) {
      count -= 8;
      out += static_cast<char>(bits >> count & 0xFF);
    }
  }
  return count != 6;  // a single left-over digit encodes nothing
}

Resource read_data_uri(const std::string& uri, const std::string& file, const std::string& place,
                       std::uintmax_t max_bytes) {
  const std::size_t comma = uri.find(',');
  if (comma == std::string::npos) throw InputError(file, place, "data URI without a comma");
  const std::string header = uri.substr(5, comma - 5);
  Resource resource;
  resource.mime_type = header.substr(0, header.find(';'));
  // 3 bytes for 4 characters.
  if ((uri.size() - comma) / 4 * 3 > max_bytes)
    throw InputError(file, place, "data URI exceeds the limit of " + std::to_string(max_bytes) + " bytes");
  const std::string ending = ";base64";
  const bool is_base64 =
      header.size() >= ending.size() && header.compare(header.size() - ending.size(), ending.size(), ending) == 0;
  if (!is_base64) {
    resource.bytes = percent_decoded(uri.substr(comma + 1));
  } else if (!decode_base64(uri.data() + comma + 1, uri.size() - comma - 1, resource.bytes)) {
    throw InputError(file, place, "data URI is not valid base64");
  }
  return resource;
}

/// A link may lead anywhere: into a file that whoever made the glTF was never given.
void require_inside(const fs::path& path, const fs::path& folder, const std::string& uri, const std::string& file,
                    const std::string& place) {
  std::error_code error;
  const fs::path root = fs::weakly_canonical(folder.empty() ? fs::path(".") : folder, error);
  const fs::path real = error ? fs::path() : fs::weakly_canonical(path, error);
  if (error) throw InputError(file, place, path.string() + ": cannot be resolved: " + error.message());
  const fs::path below = real.lexically_relative(root);
  if (!below.empty() && *below.begin() != "..") return;
  throw InputError(file, place,
                   "refusing " + quoted(uri) + ": it is a link to " + real.string() +
                       ", outside the folder of the glTF file; copy the file there");
}

/// The relative path a URI names, percent-decoded.
fs::path safe_relative_path(const std::string& uri, const std::string& file, const std::string& place) {
  if (uri.empty()) throw InputError(file, place, "the uri is empty");
  const std::string path = percent_decoded(uri);
  if (has_scheme(uri) || has_scheme(path)) {
    throw InputError(file, place,
                     "refusing " + quoted(uri) + ": only data URIs and files beside the glTF are read; download it");
  }
  if (path.find('\0') != std::string::npos) throw InputError(file, place, "the uri contains a NUL character");
  if (path.find('\\') != std::string::npos)
    throw InputError(file, place, "refusing " + quoted(uri) + ": a uri separates folders by '/', not by '\\'");
  if (path.front() == '/') throw InputError(file, place, "refusing the absolute path " + quoted(uri));
  for (const fs::path& part : fs::path(path)) {
    if (part == "..")
      throw InputError(file, place, "refusing " + quoted(uri) + ": it leaves the folder of the glTF file");
  }
  return path;
}

}  // namespace

fs::path path_of_uri(const std::string& uri, const fs::path& folder, const std::string& file,
                     const std::string& place) {
  const fs::path path = folder / safe_relative_path(uri, file, place);
  require_inside(path, folder, uri, file, place);
  return path;
}

bool is_git_lfs_pointer(const std::string& bytes) { return bytes.rfind("version https://git-lfs", 0) == 0; }

Resource read_uri(const std::string& uri, const fs::path& folder, const std::string& file, const std::string& place,
                  std::uintmax_t max_bytes) {
  if (uri.rfind("data:", 0) == 0) return read_data_uri(uri, file, place, max_bytes);
  const fs::path path = path_of_uri(uri, folder, file, place);
  Resource resource;
  try {
    resource.bytes = read_file(path, max_bytes);
  } catch (const InputError& error) {
    throw InputError(file, place, path.string() + ": " + error.problem());
  }
  if (is_git_lfs_pointer(resource.bytes)) {
    throw InputError(file, place, path.string() + " is a Git LFS pointer, not the file itself: run 'git lfs pull'");
  }
  return resource;
}

}  // namespace anigen::io::gltf_import
