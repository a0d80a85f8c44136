#include "anigen/io/rigs/split.h"

#include <algorithm>
#include <map>
#include <set>
#include <string_view>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/rigs/file_list.h"

namespace anigen::io {
namespace {

constexpr char kSampleSign = '#';

bool one_of(const std::string& word, std::initializer_list<const char*> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

bool is_shard(const std::string& name) { return one_of(lower_extension(name), {".npz", ".pt", ".pth"}); }

std::string without_extension(const std::string& name) {
  const std::string extension = lower_extension(name);
  const bool known =
      one_of(extension, {".glb", ".gltf", ".fbx", ".dae", ".obj", ".ply", ".stl", ".txt", ".npz", ".pt", ".pth"});
  return known ? name.substr(0, name.size() - extension.size()) : name;
}

/// The path without leading folders, one after the other.
void add_path(const std::string& path, NameForms& forms) {
  std::vector<std::string> parts;
  for (std::size_t start = 0; start <= path.size();) {
    const std::size_t end = std::min(path.find('/', start), path.size());
    const std::string part = path.substr(start, end - start);
    if (part == "..") return;  // leads out of the folder that names are about
    if (!part.empty() && part != ".") parts.push_back(part);
    start = end + 1;
  }
  if (parts.size() > 1 && names_no_asset(parts.back())) parts.pop_back();
  std::string form;
  for (std::size_t i = parts.size(); i-- > 0;) {
    form = parts[i] + (form.empty() ? "" : "/") + form;
    const auto signs = std::count(form.begin(), form.end(), kSampleSign);
    int& count = forms[form];
    count = std::max(count, static_cast<int>(parts.size() - i) + static_cast<int>(signs));
  }
}

}  // namespace

bool names_no_asset(const std::string& stem) {
  return one_of(stem,
                {"mesh", "raw_data", "skeleton_voxelized", "result", "rigged", "rig", "model", "scene", "output"});
}

std::string key_of_sample(const std::string& name) {
  const std::size_t sign = name.find(kSampleSign);
  return sign != std::string::npos && is_shard(name.substr(0, sign)) ? name.substr(sign + 1) : "";
}

bool is_sha256(const std::string& text) {
  constexpr std::size_t kDigits = 64;
  return text.size() == kDigits && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

NameForms name_forms(const std::string& name) {
  NameForms forms;
  const std::string key = key_of_sample(name);
  if (!key.empty()) add_path(key, forms);
  add_path(key.empty() ? without_extension(name) : name, forms);
  return forms;
}

NameForms name_forms(const ShapeSource& source, const std::string& id) {
  NameForms forms = name_forms(id);
  for (const std::string& name : source.other_names(id)) {
    for (const auto& [form, parts] : name_forms(name)) forms.emplace(form, parts);
  }
  return forms;
}

void NameIndex::add(const std::string& id, const NameForms& forms) {
  for (const auto& [form, parts] : forms) ids_[form].emplace(id, parts);
}

void NameIndex::add(const std::string& id, const std::vector<std::string>& names) {
  add(id, name_forms(id));
  for (const std::string& name : names) add(id, name_forms(name));
}

std::set<std::string> NameIndex::find(const NameForms& forms) const {
  std::set<std::string> found;
  int most = -1;
  for (const auto& [form, parts] : forms) {
    const auto there = ids_.find(form);
    if (there == ids_.end()) continue;
    for (const auto& [id, own_parts] : there->second) {
      const int shared = std::min(parts, own_parts);
      if (shared < most) continue;
      if (shared > most) found.clear();
      most = shared;
      found.insert(id);
    }
  }
  return found;
}

std::string NameIndex::find_one(const std::string& name, const std::string& file, const std::string& place) const {
  const std::set<std::string> found = find(name_forms(name));
  if (found.size() > 1)
    throw InputError(file, place, "\"" + name + "\" could be meant for several assets: " + listed(found));
  return found.empty() ? "" : *found.begin();
}

void add_content_ids(const ShapeSource& source, const std::vector<std::string>& ids, NameIndex& index) {
  for (const std::string& id : ids) {
    try {
      const std::string content = source.sample_id(id);
      if (!content.empty()) index.add(id, NameForms{{content, 1}});
    } catch (const InputError&) {
      continue;  // whoever reads the shape itself says what is wrong with it
    }
  }
}

std::string listed(const std::set<std::string>& names, std::size_t most) {
  std::string text;
  std::size_t told = 0;
  for (const std::string& name : names) {
    if (++told > most) return text + " and " + std::to_string(names.size() - most) + " more";
    text += (text.empty() ? "" : ", ") + name;
  }
  return text;
}

std::vector<SplitLine> split_lines(const std::filesystem::path& file) {
  constexpr std::string_view kBlanks = " \t\r\v\f";
  const std::string text = read_file(file, std::uintmax_t{1} << 28);
  std::vector<SplitLine> lines;
  std::size_t number = 0;
  for (std::size_t start = 0; start < text.size();) {
    const std::size_t end = std::min(text.find('\n', start), text.size());
    std::string_view line = std::string_view(text).substr(start, end - start);
    start = end + 1;
    ++number;
    const std::size_t first = line.find_first_not_of(kBlanks);
    if (first == std::string_view::npos || line[first] == '#') continue;
    line = line.substr(first, line.find_last_not_of(kBlanks) - first + 1);
    lines.push_back({std::string(line), number});
  }
  return lines;
}

std::vector<SplitLine> read_split(const std::filesystem::path& file) {
  std::vector<SplitLine> lines = split_lines(file);
  if (lines.empty()) throw InputError(file.string(), "", "the split names no id");
  return lines;
}

std::vector<std::string> select_ids(const ShapeSource& source, const std::vector<std::filesystem::path>& splits,
                                    std::size_t most) {
  std::vector<std::string> all = source.ids();
  if (splits.empty()) {
    if (most > 0 && all.size() > most) all.resize(most);
    return all;
  }
  const std::set<std::string> known(all.begin(), all.end());
  NameIndex named;
  for (const std::string& id : all) named.add(id, name_forms(source, id));
  bool contents = false;
  const auto id_of = [&](const std::string& name, const std::string& file, const std::string& place) {
    if (known.count(name) > 0) return name;
    std::string id = named.find_one(name, file, place);
    if (!id.empty() || !is_sha256(name) || contents) return id;
    contents = true;  // every file is read for it: only once, and only when it is asked for
    add_content_ids(source, all, named);
    return named.find_one(name, file, place);
  };
  std::set<std::string> wanted;
  for (const std::filesystem::path& split : splits) {
    for (const SplitLine& line : read_split(split)) {
      if (most > 0 && wanted.size() == most) break;
      const std::string place = "line " + std::to_string(line.line);
      const std::string id = id_of(line.id, split.string(), place);
      if (id.empty())
        throw InputError(split.string(), place, "there is no \"" + line.id + "\" in " + source.describe());
      wanted.insert(id);
    }
  }
  std::vector<std::string> selected;
  for (const std::string& id : all) {
    if (wanted.count(id) > 0) selected.push_back(id);
  }
  return selected;
}

}  // namespace anigen::io
