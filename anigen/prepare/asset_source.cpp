#include "anigen/prepare/asset_source.h"

#include <algorithm>
#include <cctype>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/core/sha256.h"

namespace anigen::prepare {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMaxFileBytes = std::uintmax_t{1} << 30;

/// Raised whenever make_creature() gives another asset for the same numbers, so that old entries are not mistaken
/// for new ones.
constexpr int kCreatureRecipeVersion = 1;

std::string lower_extension(const fs::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

bool is_asset_file(const fs::path& path) {
  const std::string extension = lower_extension(path);
  return extension == ".glb" || extension == ".gltf";
}

AssetSource file_source(const fs::path& file, const std::string& local_path, const std::string& input_name) {
  AssetSource source;
  source.file = file;
  source.local_path = local_path;
  source.file_identifier = input_name + "/" + local_path;
  return source;
}

/// "a%20b.bin" → "a b.bin"; a '%' that starts no escape stays.
std::string percent_decoded(const std::string& uri) {
  std::string text;
  for (std::size_t i = 0; i < uri.size(); ++i) {
    const auto digit = [&](std::size_t at) {
      return at < uri.size() && std::isxdigit(static_cast<unsigned char>(uri[at]));
    };
    if (uri[i] == '%' && digit(i + 1) && digit(i + 2)) {
      text += static_cast<char>(std::stoi(uri.substr(i + 1, 2), nullptr, 16));
      i += 2;
    } else {
      text += uri[i];
    }
  }
  return text;
}

std::string gltf_id(const fs::path& file) {
  const std::string text = read_file(file, kMaxFileBytes);
  Sha256 digest;
  digest.update(text);
  const Json json = parse_json(text, file.string(), JsonLimits{128});
  const auto buffers = json.is_object() ? json.find("buffers") : json.end();
  if (buffers != json.end() && buffers->is_array()) {
    for (std::size_t i = 0; i < buffers->size(); ++i) {
      const Json& buffer = (*buffers)[i];
      if (!buffer.is_object() || !buffer.contains("uri") || !buffer["uri"].is_string()) continue;
      const std::string uri = buffer["uri"].get<std::string>();
      if (uri.rfind("data:", 0) == 0) continue;
      const fs::path relative = percent_decoded(uri);
      const bool leaves = std::find(relative.begin(), relative.end(), "..") != relative.end();
      if (relative.empty() || relative.is_absolute() || leaves || uri.find('\0') != std::string::npos) {
        throw InputError(file.string(), "/buffers/" + std::to_string(i) + "/uri",
                         "must be a relative path inside the folder of the file");
      }
      digest.update(read_file(file.parent_path() / relative, kMaxFileBytes));
    }
  }
  return digest.finish();
}

}  // namespace

std::vector<AssetSource> find_assets(const std::vector<fs::path>& inputs) {
  std::vector<AssetSource> sources;
  for (const fs::path& given : inputs) {
    std::error_code error;
    if (!fs::exists(given, error)) throw InputError(given.string(), "", "no such file or folder");
    // "folder/" has an empty file name; its own name is wanted for file_identifier.
    const fs::path input = given.has_filename() ? given : given.parent_path();
    if (!fs::is_directory(input, error)) {
      if (!is_asset_file(input)) throw InputError(given.string(), "", "expected a folder, a .glb or a .gltf");
      sources.push_back(
          file_source(input, input.filename().string(), fs::absolute(input).parent_path().filename().string()));
      continue;
    }
    std::vector<std::string> found;
    fs::recursive_directory_iterator entry(input, fs::directory_options::skip_permission_denied, error), end;
    for (; !error && entry != end; entry.increment(error)) {
      std::error_code ignored;
      if (entry->is_regular_file(ignored) && is_asset_file(entry->path())) {
        found.push_back(entry->path().lexically_relative(input).generic_string());
      }
    }
    if (error) throw InputError(given.string(), "", "cannot list the folder: " + error.message());
    if (found.empty()) throw InputError(given.string(), "", "holds no .glb or .gltf");
    std::sort(found.begin(), found.end());
    const std::string name = fs::weakly_canonical(input, error).filename().string();
    for (const std::string& local : found) sources.push_back(file_source(input / local, local, name));
  }
  return sources;
}

std::vector<AssetSource> procedural_sources(std::uint64_t seed, std::size_t count) {
  std::vector<AssetSource> sources(count);
  for (std::size_t i = 0; i < count; ++i) {
    sources[i].seed = seed;
    sources[i].index = i;
    sources[i].file_identifier = "procedural/" + std::to_string(seed) + "/" + std::to_string(i);
  }
  return sources;
}

std::string asset_id(const AssetSource& source) {
  if (source.procedural()) return sha256(source.file_identifier + "/" + std::to_string(kCreatureRecipeVersion));
  if (lower_extension(source.file) == ".gltf") return gltf_id(source.file);
  return sha256(read_file(source.file, kMaxFileBytes));
}

}  // namespace anigen::prepare
