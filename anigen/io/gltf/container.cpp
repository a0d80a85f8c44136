#include "anigen/io/gltf/container.h"

#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/ndarray.h"

namespace anigen::io::gltf_import {

std::optional<JsonPlace> JsonPlace::find(const char* key) const {
  expect(value_->is_object(), "an object");
  const auto found = value_->find(key);
  if (found == value_->end()) return std::nullopt;
  return JsonPlace(*found, *file_, pointer_ + "/" + escaped_for_pointer(key));
}

JsonPlace JsonPlace::at(const char* key) const {
  std::optional<JsonPlace> member = find(key);
  if (!member) fail(std::string("'") + key + "' is missing");
  return *member;
}

std::vector<std::string> JsonPlace::keys() const {
  expect(value_->is_object(), "an object");
  std::vector<std::string> result;
  for (const auto& item : value_->items()) result.push_back(item.key());
  return result;
}

std::uint64_t JsonPlace::integer(std::uint64_t low, std::uint64_t high) const {
  std::uint64_t result = 0;
  if (value_->is_number_unsigned()) {
    result = value_->get<std::uint64_t>();
  } else if (value_->is_number_float()) {
    const double number = value_->get<double>();
    if (!(number >= 0.0 && number <= 9007199254740992.0) || number != std::floor(number))
      fail("expected a whole number ≥ 0");
    result = static_cast<std::uint64_t>(number);
  } else if (value_->is_number_integer()) {
    fail("expected a number ≥ 0, found " + std::to_string(value_->get<std::int64_t>()));
  } else {
    expect(false, "a whole number");
  }
  if (result < low || result > high)
    fail(std::to_string(result) + " is outside [" + std::to_string(low) + ", " + std::to_string(high) + "]");
  return result;
}

double JsonPlace::number() const {
  expect(value_->is_number(), "a number");
  const double result = value_->get<double>();
  if (!std::isfinite(result)) fail("the number is not finite");
  return result;
}

std::vector<double> JsonPlace::numbers(std::size_t count) const {
  if (size() != count) fail("expected " + std::to_string(count) + " numbers, found " + std::to_string(size()));
  std::vector<double> result(count);
  for (std::size_t i = 0; i < count; ++i) result[i] = (*this)[i].number();
  return result;
}

int JsonPlace::as_index(std::size_t count, const char* what) const {
  const std::uint64_t result = integer(0, 0x7FFFFFFF);
  if (result >= count)
    fail(std::string("there is no ") + what + " " + std::to_string(result) + ": the file has " + std::to_string(count));
  return static_cast<int>(result);
}

void Notes::add(const std::string& code, const std::string& sentence) {
  constexpr std::size_t kMostSentences = 8;  // of one code; more would bury the report
  std::size_t same = 0;
  for (const Entry& entry : entries_) {
    if (entry.code != code) continue;
    if (entry.text == sentence || ++same >= kMostSentences) return;
  }
  entries_.push_back({code, sentence, 0});
}

void Notes::tally(const std::string& code, const std::string& what, std::size_t count) {
  if (count == 0) return;
  for (Entry& entry : entries_) {
    if (entry.code == code && entry.text == what) {
      entry.count += count;
      return;
    }
  }
  entries_.push_back({code, what, count});
}

std::vector<ImportNote> Notes::take() const {
  std::vector<ImportNote> result;
  for (const Entry& entry : entries_) {
    result.push_back({entry.code, entry.count == 0 ? entry.text : std::to_string(entry.count) + " " + entry.text});
  }
  return result;
}

namespace {

constexpr std::uint32_t kJsonChunk = 0x4E4F534A;
constexpr std::uint32_t kBinaryChunk = 0x004E4942;

std::uint64_t u32_at(std::string_view bytes, std::size_t offset) { return little_endian(bytes.substr(offset, 4)); }

std::string byte(std::size_t offset) { return "byte " + std::to_string(offset); }

// The text that Git LFS leaves in place of a file that was not downloaded.
bool is_git_lfs_pointer(const std::string& bytes) { return bytes.rfind("version https://git-lfs", 0) == 0; }

// The JSON chunk's text; sets `binary`. GLB: 12 bytes of header, then chunks of length, type, data.
std::string_view split_glb(std::string_view bytes, Container& container) {
  const std::string& file = container.file;
  if (bytes.size() < 20) throw InputError(file, byte(bytes.size()), "GLB ends inside its header: truncated file");
  const std::uint64_t version = u32_at(bytes, 4);
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
    const std::uint64_t type = u32_at(bytes, offset + 4);
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
    } else if (chunk > 0) {
      container.further_chunks += bytes.substr(offset - 8, size + 8);
    }
    offset += size;
  }
  return json;
}

}  // namespace

void read_container(const std::filesystem::path& path, const ImportOptions& options, Container& container,
                    bool keep_text) {
  container.file = path.string();
  container.folder = path.parent_path();
  split_container(read_file(path, options.max_file_bytes), options, container, keep_text);
}

void split_container(std::string content, const ImportOptions& options, Container& container, bool keep_text) {
  container.bytes = std::move(content);
  const std::string& bytes = container.bytes;
  if (bytes.empty()) throw InputError(container.file, "byte 0", "the file is empty");
  if (is_git_lfs_pointer(bytes))
    throw InputError(container.file, "byte 0", "a Git LFS pointer, not the file itself: run 'git lfs pull'");
  const bool binary = bytes.compare(0, 4, "glTF") == 0;
  const std::string_view text = binary ? split_glb(bytes, container) : std::string_view(bytes);
  if (!binary) {
    const std::size_t first = text.find_first_not_of("\xEF\xBB\xBF \t\r\n");
    if (first == std::string_view::npos || text[first] != '{')
      throw InputError(container.file, "byte 0", "neither a GLB nor a JSON object: not a glTF file");
  }
  container.json = parse_json(text, container.file, JsonLimits{options.max_json_depth});
  if (binary || keep_text)
    container.text = text;
  else
    std::string().swap(container.bytes);
}

std::string glb_bytes(std::string text, std::string_view binary, const std::string& file,
                      std::string_view further_chunks) {
  constexpr std::uint64_t kHeader = 12, kChunkHeader = 8;
  text.append((4 - text.size() % 4) % 4, ' ');
  const std::size_t padding = (4 - binary.size() % 4) % 4;
  const std::uint64_t total =
      kHeader + kChunkHeader + text.size() + kChunkHeader + binary.size() + padding + further_chunks.size();
  if (total > std::numeric_limits<std::uint32_t>::max())
    throw NotSupportedError(file, "", "a .glb of " + std::to_string(total) + " bytes (the format ends at 4 GiB)");
  std::string bytes;
  bytes.reserve(static_cast<std::size_t>(total));
  const auto append_word = [&bytes](std::uint64_t value) {
    for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<char>((value >> shift) & 0xFF));
  };
  bytes += "glTF";
  append_word(2);
  append_word(total);
  append_word(text.size());
  append_word(kJsonChunk);
  bytes += text;
  append_word(binary.size() + padding);
  append_word(kBinaryChunk);
  bytes += binary;
  bytes.append(padding, '\0');
  bytes += further_chunks;
  return bytes;
}

namespace {

namespace fs = std::filesystem;

// Error messages quote URIs; data URIs and hostile ones can be long.
std::string quoted(const std::string& uri) {
  std::string result = "'";
  for (const char c : uri.substr(0, 80)) result += std::isprint(static_cast<unsigned char>(c)) != 0 ? c : '?';
  return result + (uri.size() > 80 ? "…'" : "'");
}

std::string percent_decoded(const std::string& text) {
  std::string result;
  result.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    unsigned char code = 0;
    const char* digits = text.data() + i + 1;
    if (text[i] == '%' && i + 2 < text.size() && std::from_chars(digits, digits + 2, code, 16).ptr == digits + 2) {
      result += static_cast<char>(code);
      i += 2;
    } else {
      result += text[i];
    }
  }
  return result;
}

#define ANIGEN_LETTERS_AND_DIGITS "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789"

// RFC 3986: a letter, then letters, digits, '+', '-', '.', up to ':'.
bool has_scheme(const std::string& uri) {
  const std::size_t end = uri.find_first_not_of(ANIGEN_LETTERS_AND_DIGITS "+-.");
  return end != std::string::npos && uri[end] == ':' && std::isalpha(static_cast<unsigned char>(uri[0])) != 0;
}

// Value of each base64 digit, of the URL-safe alphabet too, which some exporters use; −1 for other characters.
constexpr std::array<std::int8_t, 256> base64_values() {
  std::array<std::int8_t, 256> values{};
  for (std::int8_t& value : values) value = -1;
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (std::size_t i = 0; i < kDigits.size(); ++i)
    values[static_cast<unsigned char>(kDigits[i])] = static_cast<std::int8_t>(i);
  values['-'] = 62;
  values['_'] = 63;
  return values;
}

// tinygltf's decoder searches its alphabet for every digit (25 times the time of this table), knows seven media types,
// and stops without a word at a character outside the alphabet.
bool decode_base64(std::string_view digits, std::string& bytes) {
  static constexpr std::array<std::int8_t, 256> kValues = base64_values();
  digits = digits.substr(0, digits.find_last_not_of('=') + 1);
  if (digits.size() % 4 == 1) return false;
  bytes.clear();
  bytes.reserve(digits.size() / 4 * 3 + 3);
  std::uint32_t bits = 0;
  int count = 0;
  for (const char digit : digits) {
    const std::int8_t value = kValues[static_cast<unsigned char>(digit)];
    if (value < 0) return false;
    bits = bits << 6 | static_cast<std::uint32_t>(value);
    if ((count += 6) < 8) continue;
    count -= 8;
    bytes += static_cast<char>(bits >> count);
  }
  return true;
}

std::string read_data_uri(const std::string& uri, const std::string& file, const std::string& place,
                          std::uintmax_t max_bytes) {
  const std::size_t comma = uri.find(',');
  if (comma == std::string::npos) throw InputError(file, place, "data URI without a comma");
  const std::string header = uri.substr(0, comma), ending = ";base64";
  // 3 bytes for 4 characters.
  if ((uri.size() - comma) / 4 * 3 > max_bytes)
    throw InputError(file, place, "data URI exceeds the limit of " + std::to_string(max_bytes) + " bytes");
  const std::size_t ends = header.rfind(ending);
  if (ends == std::string::npos || ends + ending.size() != header.size()) return percent_decoded(uri.substr(comma + 1));
  std::string bytes;
  if (!decode_base64(std::string_view(uri).substr(comma + 1), bytes))
    throw InputError(file, place, "data URI is not valid base64");
  return bytes;
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

const fs::path& no_folder() {
  static const fs::path none = "/dev/null";
  return none;
}

fs::path path_of_uri(const std::string& uri, const fs::path& folder, const std::string& file,
                     const std::string& place) {
  const fs::path relative = safe_relative_path(uri, file, place);
  if (folder == no_folder())
    throw InputError(file, place, "a file in memory cannot refer to \"" + relative.string() + "\": embed it");
  const fs::path path = folder / relative;
  require_inside(path, folder, uri, file, place);
  return path;
}

std::string read_uri(const std::string& uri, const fs::path& folder, const std::string& file, const std::string& place,
                     std::uintmax_t max_bytes) {
  if (is_data_uri(uri)) return read_data_uri(uri, file, place, max_bytes);
  const fs::path path = path_of_uri(uri, folder, file, place);
  std::string bytes;
  try {
    bytes = read_file(path, max_bytes);
  } catch (const InputError& error) {
    throw InputError(file, place, path.string() + ": " + error.problem());
  }
  if (is_git_lfs_pointer(bytes))
    throw InputError(file, place, path.string() + " is a Git LFS pointer, not the file itself: run 'git lfs pull'");
  return bytes;
}

}  // namespace anigen::io::gltf_import
