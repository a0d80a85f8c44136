#include "anigen/pipeline/picture_list.h"

#include <algorithm>
#include <set>
#include <string>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/rigs/dataset_list.h"
#include "anigen/io/rigs/file_list.h"
#include "anigen/io/rigs/split.h"
#include "anigen/loaders/files/view_files.h"
#include "anigen/raytrace/views/transforms_json.h"

namespace anigen::pipeline {

namespace fs = std::filesystem;

NamedPicture::NamedPicture(fs::path picture) : file(std::move(picture)), name(file.stem().string()) {}
NamedPicture::NamedPicture(fs::path picture, std::string called) : file(std::move(picture)), name(std::move(called)) {}

std::vector<NamedPicture> pictures_at(const fs::path& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) return {NamedPicture(path)};
  static const std::set<std::string> kExtensions{".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff"};
  std::vector<fs::path> pictures;
  for (const fs::directory_entry& entry : fs::directory_iterator(path, error)) {
    if (entry.is_regular_file(error) && kExtensions.count(io::lower_extension(entry.path())) > 0)
      pictures.push_back(entry.path());
  }
  if (pictures.empty()) {
    throw InputError(path.string(), "", "holds no picture (png, jpg, jpeg, webp, bmp, tif, tiff)");
  }
  std::sort(pictures.begin(), pictures.end());
  return {pictures.begin(), pictures.end()};
}

std::vector<NamedPicture> pictures_of_dataset(const fs::path& dataset, const std::vector<fs::path>& splits,
                                              std::size_t most) {
  if (splits.empty()) throw InputError("", "--split", "which assets' pictures? A file of ids, such as splits/test.txt");
  std::vector<NamedPicture> pictures;
  std::error_code missing;
  std::set<std::string> known, seen;
  io::NameIndex index;
  if (fs::exists(dataset / "metadata.csv", missing)) {
    for (const io::DatasetItem& item : io::list_dataset(dataset)) {
      known.insert(item.id);
      index.add(item.id, item.other_names);
    }
  }
  for (const fs::path& split : splits) {
    for (const io::SplitLine& line : io::read_split(split)) {
      if (most > 0 && pictures.size() == most) return pictures;
      const std::string place = "line " + std::to_string(line.line);
      std::string id = known.count(line.id) > 0 ? line.id : index.find_one(line.id, split.string(), place);
      if (id.empty()) id = line.id;  // a folder of pictures without a table
      if (!seen.insert(id).second) continue;
      const fs::path folder = dataset / "renders_cond" / id;
      std::error_code error;
      if (id.find('/') != std::string::npos || !fs::is_regular_file(folder / "transforms.json", error)) {
        throw InputError(split.string(), place,
                         "asset '" + line.id + "' has no condition views in " + dataset.string() +
                             "; anigen-prepare --cond-views makes them");
      }
      const fs::path picture = folder / raytrace::read_transforms(folder / "transforms.json").frames.front().file_path;
      pictures.emplace_back(picture, id);
      const fs::path normals = loaders::normal_picture_of(picture);
      if (fs::is_regular_file(normals, error)) pictures.back().normal_map = normals;
    }
  }
  return pictures;
}

void require_distinct_names(const std::vector<NamedPicture>& pictures) {
  std::set<std::string> seen;
  for (const auto& [file, name, normal_map] : pictures) {
    static_cast<void>(normal_map);
    if (name.empty() || name == "." || name == "..")
      throw InputError(file.string(), "", "has no name that a folder could have");
    if (!seen.insert(name).second) throw InputError("", "--image", "two pictures have the name '" + name + "'");
  }
}

}  // namespace anigen::pipeline
