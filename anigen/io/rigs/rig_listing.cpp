#include "anigen/io/rigs/rig_listing.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <string_view>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/rigs/anymate.h"
#include "anigen/io/rigs/articulation_xl.h"
#include "anigen/io/rigs/rig_arrays.h"
#include "anigen/io/rigs/rig_reader.h"
#include "anigen/io/rigs/text_rig.h"

namespace anigen::io {

namespace {

constexpr char kSampleSign = '#';

bool is_shard(const std::string& name) { return has_extension(name, {".npz", ".pt", ".pth"}); }

std::string without_extension(const std::string& name) {
  const bool known = has_extension(
      name, {".glb", ".gltf", ".vrm", ".fbx", ".dae", ".obj", ".ply", ".stl", ".3mf", ".txt", ".npz", ".pt", ".pth"});
  return known ? name.substr(0, name.size() - lower_extension(name).size()) : name;
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
  static const std::set<std::string> kinds = {
      "mesh", "raw_data", "skeleton_voxelized", "result", "rigged", "rig", "model", "scene", "output"};
  return kinds.count(stem) > 0;
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

namespace fs = std::filesystem;

namespace {

/// Extensions with the format that they promise; an .npz may hold Articulation-XL samples as well.
const std::map<std::string, RigFormat>& formats() {
  static const std::map<std::string, RigFormat> all = {
      {".glb", RigFormat::kGltf},      {".gltf", RigFormat::kGltf},  {".vrm", RigFormat::kGltf},
      {".fbx", RigFormat::kAssimp},    {".dae", RigFormat::kAssimp}, {".txt", RigFormat::kTextRig},
      {".npz", RigFormat::kRigArrays}, {".pt", RigFormat::kAnymate}, {".pth", RigFormat::kAnymate}};
  return all;
}

/// Files that the buffers and images of a glTF name.
std::vector<fs::path> files_of_gltf(const fs::path& file) {
  gltf_import::Container container;
  gltf_import::read_container(file, {}, container);
  std::vector<fs::path> files;
  for (const char* kind : {"buffers", "images"}) {
    if (!container.json.is_object() || !container.json.contains(kind)) continue;
    for (const Json& entry : container.json[kind]) {
      const std::string uri =
          entry.is_object() && entry.contains("uri") && entry["uri"].is_string() ? entry["uri"].get<std::string>() : "";
      if (!uri.empty() && uri.rfind("data:", 0) != 0)
        files.push_back(gltf_import::path_of_uri(uri, container.folder, container.file, ""));
    }
  }
  return files;
}

/// Names that end in this, such as ".png", anywhere in a file: paths lose their folders.
void add_names_in(const std::string& bytes, const std::string& ending, std::set<std::string>& names) {
  const std::string before("/\\\"'<>|*?\r\n\t\0", 12);
  for (std::size_t at = bytes.find(ending); at != std::string::npos; at = bytes.find(ending, at + 1)) {
    std::size_t begin = bytes.find_last_of(before, at);
    begin = begin == std::string::npos ? 0 : begin + 1;
    const std::string name = bytes.substr(begin, at + ending.size() - begin);
    names.insert(name);
    names.insert(name.substr(name.rfind(' ') + 1));  // after a keyword; all of it without a space
  }
}

/// Files that a mesh names in its text or, as FBX does, among binary data.
std::vector<fs::path> files_named_in(const fs::path& file) {
  const ImportOptions limits;
  const std::vector<std::string> endings = {".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG"};
  const fs::path folder = file.parent_path();
  const std::string bytes = read_file(file, limits.max_file_bytes);
  std::set<std::string> names, materials;
  for (const std::string& ending : endings) add_names_in(bytes, ending, names);
  add_names_in(bytes, ".mtl", materials);
  for (const std::string& name : materials) {
    std::error_code error;
    if (!fs::is_regular_file(folder / name, error)) continue;
    const std::string text = read_file(folder / name, limits.max_file_bytes);
    for (const std::string& ending : endings) add_names_in(text, ending, names);
  }
  names.merge(materials);
  std::vector<fs::path> files;
  for (const std::string& name : names) {
    for (const fs::path& place : {folder, folder / "textures"}) files.push_back(place / name);
  }
  return files;
}

}  // namespace

FileListSource::FileListSource(std::vector<Entry> entries, Reader reader, std::string description, bool single)
    : entries_(std::move(entries)), reader_(std::move(reader)), description_(std::move(description)), single_(single) {
  for (const Entry& entry : entries_) {
    const auto [there, is_new] = files_.try_emplace(entry.id, entry.file);
    if (!is_new) {
      throw InputError(entry.file.string(), "",
                       "its id \"" + entry.id + "\" is also that of " + there->second.string() + "; keep one of them");
    }
    ++stems_[entry.file.stem().string()];
  }
}

std::vector<std::string> FileListSource::ids() const {
  std::vector<std::string> result;
  for (const Entry& entry : entries_) result.push_back(entry.id);
  return result;
}

const fs::path& FileListSource::file(const std::string& id) const {
  const auto found = files_.find(id);
  if (found == files_.end()) throw InputError(description_, "", "there is no \"" + id + "\"");
  return found->second;
}

RiggedShape FileListSource::read(const std::string& id) const {
  require_content(file(id));
  return reader_(file(id), id);
}

std::vector<fs::path> FileListSource::files(const std::string& id) const { return files_read_with(file(id)); }

std::vector<std::string> FileListSource::other_names(const std::string& id) const {
  std::string name = file(id).stem().string();
  if (name == fs::path(id).filename().string() || names_no_asset(name) || stems_.at(name) > 1) return {};
  return {std::move(name)};
}

std::string FileListSource::sample_id(const std::string& id) const {
  RigEntry entry;
  entry.file = file(id);
  const auto format = formats().find(lower_extension(entry.file));
  if (format == formats().end() || format->second == RigFormat::kAnymate) return "";
  entry.format = format->second;
  return RigReader().content_id(entry);
}

std::string lower_extension(const fs::path& file) { return lower_case(file.extension().string()); }

bool has_extension(const fs::path& file, const std::vector<std::string>& extensions) {
  return std::find(extensions.begin(), extensions.end(), lower_extension(file)) != extensions.end();
}

std::vector<fs::path> files_below(const fs::path& folder, const std::vector<std::string>& extensions) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied, error), end;
       !error && it != end; it.increment(error)) {
    std::error_code unreadable;
    if (has_extension(it->path(), extensions) && it->is_regular_file(unreadable)) files.push_back(it->path());
  }
  if (error) throw InputError(folder.string(), "", "cannot be listed: " + error.message());
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<fs::path> files_read_with(const fs::path& file) {
  const std::string extension = lower_extension(file);
  std::vector<fs::path> files;
  try {
    if (extension == ".gltf" || extension == ".glb" || extension == ".vrm") files = files_of_gltf(file);
    if (extension == ".obj" || extension == ".fbx" || extension == ".dae") files = files_named_in(file);
    if (extension == ".txt") files.push_back(mesh_of_text_rig(file));
  } catch (const InputError&) {  // reading it will say what is wrong
    files.clear();
  }
  files.push_back(file);
  return files;
}

std::vector<FileListSource::Entry> entries_below(const fs::path& folder, const std::vector<fs::path>& files) {
  std::set<fs::path> parents;
  for (const fs::path& file : files) parents.insert(file.parent_path().lexically_relative(folder));
  const bool alone = parents.size() == files.size() && parents.count(fs::path(".")) == 0;
  std::vector<FileListSource::Entry> entries;
  for (const fs::path& file : files) {
    const fs::path below = file.lexically_relative(folder);
    const fs::path id = alone ? below.parent_path() : below.parent_path() / below.stem();
    entries.push_back({id.generic_string(), file});
  }
  return entries;
}

void require_content(const fs::path& file) {
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (!fs::exists(status)) throw InputError(file.string(), "", "there is no such file");
  if (!fs::is_regular_file(status)) throw InputError(file.string(), "", "is not a file");
  constexpr std::string_view kPointer = "version https://git-lfs.github.com/spec/";
  std::string start(kPointer.size(), '\0');
  std::ifstream in(file, std::ios::binary);
  if (!in) throw InputError(file.string(), "", "cannot be read");
  in.read(start.data(), static_cast<std::streamsize>(start.size()));
  start.resize(static_cast<std::size_t>(in.gcount()));
  if (start.empty()) throw InputError(file.string(), "byte 0", "the file is empty");
  if (start == kPointer)
    throw InputError(file.string(), "", "is a Git LFS pointer, not the file itself; fetch it with: git lfs pull");
}

std::vector<DatasetItem> list_dataset(const std::filesystem::path& root) {
  const std::filesystem::path file = root / "metadata.csv";
  const CsvTable table = read_csv(file);
  if (table.column("sha256") == CsvTable::kMissing) throw InputError(file.string(), "line 1", "no column \"sha256\"");
  std::vector<DatasetItem> items;
  std::set<std::string> seen;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    DatasetItem item;
    item.id = table.cell(row, "sha256");
    const std::string place = "row " + std::to_string(row + 1);
    const bool unsafe = item.id.empty() || item.id == "." || item.id == ".." || item.id.find('/') != std::string::npos;
    if (unsafe) throw InputError(file.string(), place, "\"" + item.id + "\" is no id");
    if (!seen.insert(item.id).second) throw InputError(file.string(), place, "the id " + item.id + " appears twice");
    item.source = table.cell(row, "source");
    for (const char* column : {"local_path", "file_identifier", "sha256"}) {
      if (item.name.empty()) item.name = table.cell(row, column);
    }
    item.variant_of = table.cell(row, "variant_of");
    if (!item.is_variant()) {
      item.uuid = table.cell(row, "uuid");
      for (const char* column : {"local_path", "file_identifier"}) {
        if (item.uuid.empty()) item.uuid = key_of_sample(table.cell(row, column));
      }
      for (const std::string& name : {item.uuid, table.cell(row, "local_path"), table.cell(row, "file_identifier")}) {
        if (!name.empty() && name != item.id) item.other_names.push_back(name);
      }
    }
    item.usable = !table.flag(row, "is_bad_skeleton", false, file.string());
    item.bad_skin = table.flag(row, "is_bad_skin", false, file.string());
    item.test = table.flag(row, "is_test", false, file.string());
    items.push_back(std::move(item));
  }
  return items;
}

DatasetSource::DatasetSource(const std::filesystem::path& root, const SourceOptions& options)
    : root_(root), options_(options), items_(list_dataset(root)) {
  for (std::size_t i = 0; i < items_.size(); ++i) index_.emplace(items_[i].id, i);
}

const DatasetItem& DatasetSource::item(const std::string& id) const {
  const auto found = index_.find(id);
  if (found == index_.end()) throw InputError((root_ / "metadata.csv").string(), "", "has no id \"" + id + "\"");
  return items_[found->second];
}

std::vector<std::string> DatasetSource::ids() const {
  std::vector<std::string> result;
  for (const DatasetItem& item : items_) result.push_back(item.id);
  return result;
}

RiggedShape DatasetSource::read(const std::string& id) const {
  const DatasetItem& row = item(id);
  const std::filesystem::path file = root_ / "skeleton" / id / "skeleton_voxelized.npz";
  require_content(file);
  RiggedShape shape = read_rig_npz(file, id);
  turn_to_z_up(shape, options_.axes, Axes::kZUp);
  if (!row.usable) shape.notes.push_back("the data set marks its skeleton as bad");
  if (row.bad_skin) shape.notes.push_back("the data set marks its skin as bad");
  return shape;
}

std::vector<std::filesystem::path> DatasetSource::files(const std::string& id) const {
  return {root_ / "metadata.csv", root_ / "skeleton" / id / "skeleton_voxelized.npz", root_ / "assets" / (id + ".glb")};
}

std::string DatasetSource::describe() const {
  return "data set " + root_.string() + ": " + std::to_string(items_.size()) + " samples";
}

std::string DatasetSource::category(const std::string& id) const {
  static const std::string prefix = "procedural:";
  const std::string& source = item(id).source;
  return source.rfind(prefix, 0) == 0 ? source.substr(prefix.size()) : "";
}

namespace {

// In the order of RigFormat.
constexpr const char* kNames[] = {"gltf", "assimp", "text_rig", "rig_arrays", "articulation_xl", "anymate", "dataset"};

/// "articulation_xlv2_test.npz", "Anymate_test.pt", but not "latest.pt".
bool is_test_shard(const fs::path& file) {
  const std::string stem = file.stem().string(), word = "test";
  if (stem.size() < word.size() || stem.compare(stem.size() - word.size(), word.size(), word) != 0) return false;
  return stem.size() == word.size() ||
         std::isalpha(static_cast<unsigned char>(stem[stem.size() - word.size() - 1])) == 0;
}

void add_samples(RigFormat format, const fs::path& file, const std::string& local_path,
                 const std::vector<std::string>& keys, std::vector<RigEntry>& entries) {
  for (const std::string& key : keys)
    entries.push_back({format, file, key, local_path + "#" + key, is_test_shard(file), key});
}

/// @param required whether a .txt that is no rig is an error
void add_file(const fs::path& file, const std::string& local_path, bool required, std::vector<RigEntry>& entries) {
  const RigFormat format = formats().at(lower_extension(file));
  const auto add = [&] { entries.push_back({format, file, "", local_path, false, ""}); };
  if (format == RigFormat::kGltf || format == RigFormat::kAssimp) return add();
  if (format == RigFormat::kTextRig) {
    if (is_text_rig(file)) return add();
    if (required) throw InputError(file.string(), "", "is no text rig: its first word is none of its keywords");
    return;
  }
  require_content(file);
  if (format == RigFormat::kAnymate)
    return add_samples(format, file, local_path, open_anymate({file}, {}, true)->ids(), entries);
  if (is_rig_npz(file)) return add();
  add_samples(RigFormat::kArticulationXl, file, local_path, open_articulation_xl(file)->ids(), entries);
}

std::vector<RigEntry> list_published(const fs::path& folder) {
  std::vector<RigEntry> entries;
  for (const DatasetItem& item : list_dataset(folder))
    entries.push_back({RigFormat::kDataset, folder, item.id, item.is_variant() ? item.id : item.name, item.test,
                       item.uuid, item.variant_of});
  if (entries.empty()) throw InputError((folder / "metadata.csv").string(), "", "the dataset has no row");
  return entries;
}

}  // namespace

const char* name_of(RigFormat format) { return kNames[static_cast<std::size_t>(format)]; }

RigFormat parse_rig_format(const std::string& word) {
  const auto* found = std::find(std::begin(kNames), std::end(kNames), word);
  if (found == std::end(kNames)) throw InputError("", "format", "\"" + word + "\" is no format of rigs");
  return static_cast<RigFormat>(found - kNames);
}

std::vector<RigEntry> list_rigs(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) throw InputError(path.string(), "", "no such file or folder");
  std::vector<RigEntry> entries;
  if (!fs::is_directory(status)) {
    if (formats().count(lower_extension(path)) == 0)
      throw InputError(path.string(), "", "expected a folder, or a .glb, .gltf, .fbx, .dae, .txt, .npz, .pt or .pth");
    add_file(path, path.filename().string(), true, entries);
    return entries;
  }
  if (fs::exists(path / "metadata.csv", error) && fs::is_directory(path / "skeleton", error))
    return list_published(path);
  std::vector<std::pair<std::string, fs::path>> files;  // sorted by the text of the path, on every system alike
  std::vector<std::string> extensions;
  for (const auto& [extension, format] : formats()) extensions.push_back(extension);
  for (const fs::path& file : files_below(path, extensions))
    files.emplace_back(file.lexically_relative(path).generic_string(), file);
  std::sort(files.begin(), files.end());
  for (const auto& [local, file] : files) {
    try {
      add_file(file, local, false, entries);
    } catch (const InputError&) {
      // One damaged shard must not hide the other files: whoever reads it says what is wrong with it.
      entries.push_back({formats().at(lower_extension(file)), file, "", local, false, ""});
    }
  }
  if (entries.empty())
    throw InputError(path.string(), "",
                     "holds no rigged asset: no .glb, .gltf, .fbx, .dae, text rig, .npz, .pt, or metadata.csv with "
                     "skeleton/");
  return entries;
}

}  // namespace anigen::io
