#include "anigen/core/config_file.h"

#include <algorithm>
#include <cstdint>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"

namespace anigen {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLongestChain = 16;
constexpr std::size_t kLongestPath = 64;

std::vector<std::string> base_files(const Json& config, const std::string& file) {
  const auto entry = config.find("extends");
  if (entry == config.end()) return {};
  const InputError wrong(file, "/extends", "must be a file name or a list of file names");
  std::vector<std::string> names;
  if (entry->is_string()) {
    names.push_back(entry->get<std::string>());
  } else if (entry->is_array()) {
    for (const Json& name : *entry) {
      if (!name.is_string()) throw wrong;
      names.push_back(name.get<std::string>());
    }
  } else {
    throw wrong;
  }
  return names;
}

// `open` are the files being read, outermost first: a file met again among them is a cycle.
Json load(const fs::path& path, std::vector<fs::path>& open) {
  const fs::path identity = fs::weakly_canonical(path);
  if (std::find(open.begin(), open.end(), identity) != open.end()) {
    throw InputError(open.back().string(), "/extends", "cycle: " + path.string() + " is already being read");
  }
  if (open.size() >= kLongestChain) {
    throw InputError(open.back().string(), "/extends",
                     "chain of more than " + std::to_string(kLongestChain) + " files");
  }
  Json config = read_json(path);
  if (!config.is_object()) throw InputError(path.string(), "", "a config must be a JSON object");
  open.push_back(identity);
  Json merged = Json::object();
  for (const std::string& name : base_files(config, path.string())) {
    merge_config(merged, load(path.parent_path() / name, open));
  }
  open.pop_back();
  config.erase("extends");
  merge_config(merged, config);
  return merged;
}

bool other_name(const Json& a, const Json& b) {
  const auto x = a.find("name"), y = b.find("name");
  return x != a.end() && y != b.end() && *x != *y;
}

Json parse_value(const std::string& text) {
  try {
    return parse_json(text, "--set");
  } catch (const InputError&) {
    return text;
  }
}

std::size_t list_index(const std::string& key, std::size_t size, const std::string& assignment) {
  const bool digits = !key.empty() && key.size() < 10 && key.find_first_not_of("0123456789") == std::string::npos;
  if (!digits || std::stoul(key) >= size) {
    throw InputError("--set", assignment, "'" + key + "' is no index into a list of " + std::to_string(size));
  }
  return std::stoul(key);
}

}  // namespace

Json load_config(const fs::path& path) {
  std::vector<fs::path> open;
  return load(path, open);
}

void merge_config(Json& base, const Json& changes) {
  if (!base.is_object() || !changes.is_object() || other_name(base, changes)) {
    base = changes;
    return;
  }
  for (const auto& [key, value] : changes.items()) {
    if (base.contains(key)) {
      merge_config(base[key], value);
    } else {
      base[key] = value;
    }
  }
}

void apply_override(Json& config, const std::string& assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw InputError("--set", assignment, "expected path.to.key=value");
  }
  const std::string path = assignment.substr(0, equals);
  Json* place = &config;
  std::size_t depth = 0;
  for (std::size_t begin = 0; begin <= path.size();) {
    const std::size_t end = std::min(path.find('.', begin), path.size());
    const std::string key = path.substr(begin, end - begin);
    if (key.empty()) throw InputError("--set", assignment, "empty name in the path");
    if (++depth > kLongestPath) throw InputError("--set", assignment, "path too deep");
    if (place->is_array()) {
      place = &(*place)[list_index(key, place->size(), assignment)];
    } else if (place->is_object()) {
      place = &(*place)[key];
      if (place->is_null() && end < path.size()) *place = Json::object();
    } else {
      throw InputError("--set", assignment, "'" + path.substr(0, begin ? begin - 1 : 0) + "' is not an object");
    }
    begin = end + 1;
  }
  *place = parse_value(assignment.substr(equals + 1));
}

void apply_overrides(Json& config, const std::vector<std::string>& assignments) {
  for (const std::string& assignment : assignments) apply_override(config, assignment);
}

void write_config(const fs::path& path, const Json& config) { write_file_atomically(path, config.dump(2) + "\n"); }

}  // namespace anigen
