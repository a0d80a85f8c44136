#include "anigen/io/rigs/file_list.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <set>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/gltf/import_container.h"
#include "anigen/io/gltf/import_uri.h"
#include "anigen/io/rigs/rig_reader.h"
#include "anigen/io/rigs/split.h"
#include "anigen/io/rigs/text_rig.h"

namespace anigen::io {

namespace fs = std::filesystem;

namespace {

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
  const fs::path& path = file(id);
  const std::string extension = lower_extension(path);
  RigEntry entry;
  entry.file = path;
  if (extension == ".glb" || extension == ".gltf") {
    entry.format = RigFormat::kGltf;
  } else if (extension == ".fbx" || extension == ".dae") {
    entry.format = RigFormat::kAssimp;
  } else if (extension == ".txt") {
    entry.format = RigFormat::kTextRig;
  } else if (extension == ".npz") {
    entry.format = RigFormat::kRigArrays;
  } else {
    return "";
  }
  return RigReader().content_id(entry);
}

std::string lower_extension(const fs::path& file) {
  std::string extension = file.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

std::vector<fs::path> files_below(const fs::path& folder, const std::vector<std::string>& extensions) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied, error), end;
       !error && it != end; it.increment(error)) {
    std::error_code unreadable;
    const std::string extension = lower_extension(it->path());
    if (std::find(extensions.begin(), extensions.end(), extension) == extensions.end()) continue;
    if (it->is_regular_file(unreadable)) files.push_back(it->path());
  }
  if (error) throw InputError(folder.string(), "", "cannot be listed: " + error.message());
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<fs::path> files_read_with(const fs::path& file) {
  const std::string extension = lower_extension(file);
  std::vector<fs::path> files;
  try {
    if (extension == ".gltf" || extension == ".glb") files = files_of_gltf(file);
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

}  // namespace anigen::io
