#include <algorithm>
#include <iterator>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/rigs/anymate_archive.h"
#include "anigen/io/rigs/articulation_xl.h"
#include "anigen/io/rigs/dataset_source.h"
#include "anigen/io/rigs/file_list.h"
#include "anigen/io/rigs/rig_arrays.h"
#include "anigen/io/rigs/scene_shape.h"
#include "anigen/io/rigs/shape_source.h"
#include "anigen/io/rigs/text_rig.h"

namespace anigen::io {

namespace {

namespace fs = std::filesystem;

enum class Format { kScene, kRigNpz, kTextRig };

const std::vector<std::string> kSceneExtensions = {".glb", ".gltf", ".fbx", ".dae"};

bool is_scene(const std::string& extension) {
  return std::find(kSceneExtensions.begin(), kSceneExtensions.end(), extension) != kSceneExtensions.end();
}

const char* name_of(Format format) {
  switch (format) {
    case Format::kRigNpz:
      return "NPZ rig";
    case Format::kTextRig:
      return "text rig";
    case Format::kScene:
      break;
  }
  return "rigged file";
}

FileListSource::Reader reader(Format format, const SourceOptions& options) {
  const Axes axes = options.axes;
  switch (format) {
    case Format::kRigNpz:
      return [axes](const fs::path& file, const std::string& id) {
        RiggedShape shape = read_rig_npz(file, id);
        turn_to_z_up(shape, axes, Axes::kZUp);
        return shape;
      };
    case Format::kTextRig:
      return [axes](const fs::path& file, const std::string& id) { return read_text_rig(file, id, axes); };
    case Format::kScene:
      break;
  }
  const bool require_rig = options.require_rig;
  return [axes, require_rig](const fs::path& file, const std::string& id) {
    return read_scene_shape(file, id, axes, require_rig);
  };
}

/// Files that carry one name in every folder say who they are by the folder.
std::string id_of_single(const fs::path& file) {
  const std::string stem = file.stem().string();
  const std::string folder = fs::absolute(file).parent_path().filename().string();
  return (stem == "raw_data" || stem == "skeleton_voxelized") && !folder.empty() ? folder : stem;
}

std::unique_ptr<ShapeSource> single(const fs::path& file, Format format, const SourceOptions& options) {
  std::vector<FileListSource::Entry> entries = {{id_of_single(file), file}};
  return std::make_unique<FileListSource>(std::move(entries), reader(format, options),
                                          std::string(name_of(format)) + " " + file.string(), true);
}

std::unique_ptr<ShapeSource> several(const fs::path& folder, const std::vector<fs::path>& files, Format format,
                                     const SourceOptions& options) {
  return std::make_unique<FileListSource>(
      entries_below(folder, files), reader(format, options),
      std::to_string(files.size()) + " " + name_of(format) + (files.size() == 1 ? "" : "s") + " in " + folder.string(),
      false);
}

std::unique_ptr<ShapeSource> open_npz(const fs::path& file, const SourceOptions& options) {
  require_content(file);
  if (is_rig_npz(file)) return single(file, Format::kRigNpz, options);
  return std::make_unique<ArticulationXlSource>(file, options);
}

std::unique_ptr<ShapeSource> open_file(const fs::path& file, const SourceOptions& options) {
  const std::string extension = lower_extension(file);
  if (is_scene(extension)) return single(file, Format::kScene, options);
  if (extension == ".txt") return single(file, Format::kTextRig, options);
  if (extension == ".npz") return open_npz(file, options);
  if (extension == ".pt" || extension == ".pth")
    return std::make_unique<AnymateSource>(std::vector<fs::path>{file}, options, true);
  if (extension == ".csv") throw InputError(file.string(), "", "a CSV of pairs names both sides at once");
  throw NotSupportedError(
      file.string(), "",
      "rigs in " + (extension.empty() ? "files without extension" : extension + " files") + "; convert them to .glb");
}

/// anigen-generate writes mesh.glb with generation.json, and beside it a solid skeleton and what else was asked for.
bool is_beside_report(const fs::path& file) { return fs::is_regular_file(file.parent_path() / "generation.json"); }

std::vector<fs::path> without_companions(const std::vector<fs::path>& scenes) {
  std::vector<fs::path> generated;
  std::copy_if(scenes.begin(), scenes.end(), std::back_inserter(generated),
               [](const fs::path& file) { return file.filename() == "mesh.glb" && is_beside_report(file); });
  return generated.empty() ? scenes : generated;
}

std::unique_ptr<ShapeSource> open_folder(const fs::path& folder, const SourceOptions& options) {
  if (fs::exists(folder / "metadata.csv") && fs::is_directory(folder / "skeleton"))
    return std::make_unique<DatasetSource>(folder, options);
  const std::vector<fs::path> scenes = without_companions(files_below(folder, kSceneExtensions));
  std::vector<fs::path> npz = files_below(folder, {".npz"});
  npz.erase(std::remove_if(npz.begin(), npz.end(), is_beside_report), npz.end());  // latents
  const std::vector<fs::path> torch = files_below(folder, {".pt", ".pth"});
  std::vector<fs::path> text = files_below(folder, {".txt"});
  text.erase(std::remove_if(text.begin(), text.end(), [](const fs::path& file) { return !is_text_rig(file); }),
             text.end());
  std::vector<fs::path> raw_data;
  std::copy_if(npz.begin(), npz.end(), std::back_inserter(raw_data),
               [](const fs::path& file) { return file.filename() == "raw_data.npz"; });
  if (!raw_data.empty()) npz = raw_data;

  std::string found;
  int formats = 0;
  const auto count = [&](std::size_t files, const char* what) {
    if (files == 0) return;
    ++formats;
    found += (found.empty() ? "" : ", ") + std::to_string(files) + " " + what;
  };
  count(scenes.size(), "glTF/FBX/DAE");
  count(npz.size(), "NPZ");
  count(torch.size(), "PyTorch");
  count(text.size(), "text rigs");
  if (formats == 0) {
    throw InputError(
        folder.string(), "",
        "holds nothing that can be read: no .glb, .gltf, .fbx, .dae, .npz, .pt, text rig, or metadata.csv with "
        "skeleton/");
  }
  if (formats > 1) {
    throw InputError(folder.string(), "", "holds several formats (" + found + "); name a sub-folder with one of them");
  }
  if (!scenes.empty()) return several(folder, scenes, Format::kScene, options);
  if (!text.empty()) return several(folder, text, Format::kTextRig, options);
  if (!torch.empty()) return std::make_unique<AnymateSource>(torch, options, false);
  return several(folder, npz, Format::kRigNpz, options);
}

}  // namespace

std::unique_ptr<ShapeSource> open_source(const fs::path& path, const SourceOptions& options) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) throw InputError(path.string(), "", "there is no such file or folder");
  return fs::is_directory(status) ? open_folder(path, options) : open_file(path, options);
}

}  // namespace anigen::io
