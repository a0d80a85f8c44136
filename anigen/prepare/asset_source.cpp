#include "anigen/prepare/asset_source.h"

#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/sha256.h"
#include "anigen/io/rigs/split.h"

namespace anigen::prepare {
namespace {

namespace fs = std::filesystem;

/// Raised whenever make_creature() gives another asset for the same numbers, so that old entries are not mistaken
/// for new ones.
constexpr int kCreatureRecipeVersion = 1;

template <typename T>
T member(const Json& json, const char* key) {
  try {
    return json.at(key).get<T>();
  } catch (const Json::exception&) {
    throw InputError("", std::string("/") + key, "is missing or of another type");
  }
}

}  // namespace

std::string AssetSource::source_path() const {
  const std::string key = io::key_of_sample(local_path);
  return key.empty() ? local_path : local_path.substr(0, local_path.size() - key.size() - 1);
}

Json to_json(const AssetSource& source) {
  Json json;
  if (source.procedural()) {
    json["format"] = "procedural";
    json["seed"] = source.seed;
    json["index"] = source.index;
  } else {
    json["format"] = io::name_of(source.format);
    json["file"] = source.file.string();
    json["key"] = source.key;
    json["local_path"] = source.local_path;
    json["is_test"] = source.is_test;
    json["uuid"] = source.uuid;
  }
  json["file_identifier"] = source.file_identifier;
  return json;
}

AssetSource asset_source_from_json(const Json& json) {
  AssetSource source;
  const auto format = member<std::string>(json, "format");
  source.file_identifier = member<std::string>(json, "file_identifier");
  if (format == "procedural") {
    source.seed = member<std::uint64_t>(json, "seed");
    source.index = member<std::uint64_t>(json, "index");
    return source;
  }
  source.format = io::parse_rig_format(format);
  source.file = member<std::string>(json, "file");
  if (source.file.empty()) throw InputError("", "/file", "is empty");
  source.key = member<std::string>(json, "key");
  source.local_path = member<std::string>(json, "local_path");
  source.is_test = member<bool>(json, "is_test");
  source.uuid = json.value("uuid", "");
  return source;
}

std::vector<AssetSource> find_assets(const std::vector<fs::path>& inputs) {
  std::vector<AssetSource> sources;
  for (const fs::path& given : inputs) {
    std::error_code error;
    // "folder/" has an empty file name; its own name is wanted for file_identifier.
    const fs::path input = given.has_filename() ? given : given.parent_path();
    const std::vector<io::RigEntry> entries = io::list_rigs(input);
    const fs::path named = fs::is_directory(input, error) ? input : fs::absolute(input).parent_path();
    const std::string name = fs::weakly_canonical(named, error).filename().string();
    for (const io::RigEntry& entry : entries) {
      AssetSource source;
      source.format = entry.format;
      source.file = entry.file;
      source.key = entry.key;
      source.local_path = entry.local_path;
      source.file_identifier = name + "/" + entry.local_path;
      source.is_test = entry.is_test;
      source.uuid = entry.uuid;
      sources.push_back(std::move(source));
    }
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

std::string asset_id(const AssetSource& source, const io::RigReader& reader) {
  if (source.procedural()) return sha256(source.file_identifier + "/" + std::to_string(kCreatureRecipeVersion));
  if (source.format == io::RigFormat::kDataset) return source.key;
  return reader.content_id(source.rig());
}

std::string asset_id(const AssetSource& source) { return asset_id(source, io::RigReader()); }

}  // namespace anigen::prepare
