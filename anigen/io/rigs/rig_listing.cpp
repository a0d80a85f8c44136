#include "anigen/io/rigs/rig_listing.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/rigs/anymate_archive.h"
#include "anigen/io/rigs/articulation_xl.h"
#include "anigen/io/rigs/dataset_list.h"
#include "anigen/io/rigs/file_list.h"
#include "anigen/io/rigs/rig_arrays.h"
#include "anigen/io/rigs/text_rig.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::pair<RigFormat, const char*>, 7> kNames = {{{RigFormat::kGltf, "gltf"},
                                                                      {RigFormat::kAssimp, "assimp"},
                                                                      {RigFormat::kTextRig, "text_rig"},
                                                                      {RigFormat::kRigArrays, "rig_arrays"},
                                                                      {RigFormat::kArticulationXl, "articulation_xl"},
                                                                      {RigFormat::kAnymate, "anymate"},
                                                                      {RigFormat::kDataset, "dataset"}}};

const std::vector<std::string>& extensions() {
  static const std::vector<std::string> all = {".glb", ".gltf", ".fbx", ".dae", ".txt", ".npz", ".pt", ".pth"};
  return all;
}

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
  const std::string extension = lower_extension(file);
  const auto add = [&](RigFormat format) { entries.push_back({format, file, "", local_path, false, ""}); };
  if (extension == ".glb" || extension == ".gltf") return add(RigFormat::kGltf);
  if (extension == ".fbx" || extension == ".dae") return add(RigFormat::kAssimp);
  if (extension == ".txt") {
    if (is_text_rig(file)) return add(RigFormat::kTextRig);
    if (required) throw InputError(file.string(), "", "is no text rig: its first word is none of its keywords");
    return;
  }
  require_content(file);
  if (extension == ".npz") {
    if (is_rig_npz(file)) return add(RigFormat::kRigArrays);
    return add_samples(RigFormat::kArticulationXl, file, local_path, ArticulationXlSource(file).ids(), entries);
  }
  add_samples(RigFormat::kAnymate, file, local_path, AnymateSource({file}, {}, true).ids(), entries);
}

std::vector<RigEntry> list_published(const fs::path& folder) {
  std::vector<RigEntry> entries;
  for (const DatasetItem& item : list_dataset(folder))
    entries.push_back(
        {RigFormat::kDataset, folder, item.id, item.is_variant ? item.id : item.name, item.test, item.uuid});
  if (entries.empty()) throw InputError((folder / "metadata.csv").string(), "", "the dataset has no row");
  return entries;
}

}  // namespace

const char* name_of(RigFormat format) {
  for (const auto& [known, name] : kNames) {
    if (known == format) return name;
  }
  return "";
}

RigFormat parse_rig_format(const std::string& word) {
  for (const auto& [format, name] : kNames) {
    if (word == name) return format;
  }
  throw InputError("", "format", "\"" + word + "\" is no format of rigs");
}

std::vector<RigEntry> list_rigs(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) throw InputError(path.string(), "", "no such file or folder");
  std::vector<RigEntry> entries;
  if (!fs::is_directory(status)) {
    const std::vector<std::string>& known = extensions();
    if (std::find(known.begin(), known.end(), lower_extension(path)) == known.end())
      throw InputError(path.string(), "", "expected a folder, or a .glb, .gltf, .fbx, .dae, .txt, .npz, .pt or .pth");
    add_file(path, path.filename().string(), true, entries);
    return entries;
  }
  if (fs::exists(path / "metadata.csv", error) && fs::is_directory(path / "skeleton", error))
    return list_published(path);
  std::vector<std::pair<std::string, fs::path>> files;  // sorted by the text of the path, on every system alike
  for (const fs::path& file : files_below(path, extensions()))
    files.emplace_back(file.lexically_relative(path).generic_string(), file);
  std::sort(files.begin(), files.end());
  for (const auto& [local, file] : files) {
    try {
      add_file(file, local, false, entries);
    } catch (const InputError&) {
      // One damaged shard must not hide the other files: whoever reads it says what is wrong with it.
      const std::string extension = lower_extension(file);
      const RigFormat format = extension == ".txt"   ? RigFormat::kTextRig
                               : extension == ".npz" ? RigFormat::kRigArrays
                                                     : RigFormat::kAnymate;
      entries.push_back({format, file, "", local, false, ""});
    }
  }
  if (entries.empty())
    throw InputError(path.string(), "",
                     "holds no rigged asset: no .glb, .gltf, .fbx, .dae, text rig, .npz, .pt, or metadata.csv with "
                     "skeleton/");
  return entries;
}

}  // namespace anigen::io
