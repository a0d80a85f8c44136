#include "anigen/eval/inspect.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/table.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/io/foreign_image.h"
#include "anigen/io/rigs/anymate.h"
#include "anigen/io/rigs/bvh.h"
#include "anigen/io/rigs/read_assimp.h"
#include "anigen/io/rigs/rig_arrays.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/io/rigs/samples.h"
#include "anigen/io/rigs/text_rig.h"

namespace anigen::eval {

namespace {

namespace fs = std::filesystem;

/// The code of notes that readers of shapes write as sentences.
constexpr const char* kPlainNote = "note";

std::string metres(double unit) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g m", unit);
  return text;
}

Geometry scene(const fs::path& file) {
  io::require_content(file);
  const std::string extension = io::lower_extension(file);
  const bool is_gltf = extension == ".glb" || extension == ".gltf" || extension == ".vrm";
  io::ImportOptions options;
  options.require_rig = false;
  Geometry geometry;
  geometry.imported = is_gltf ? io::read_gltf(file, options) : io::read_assimp(file, options);
  const io::FileFrame& frame = geometry.imported.frame;
  geometry.source = {{"format", is_gltf               ? "glTF"
                                : extension == ".fbx" ? "FBX"
                                                      : "COLLADA"},
                     {"axes", std::string(1, frame.up) + " up"},
                     {"unit", metres(frame.metres)}};
  return geometry;
}

/// Axes of a format that has no rule of its own.
std::string by_custom(char up) { return std::string(1, up) + " up by custom; the file does not say"; }

/// A shape's parts as far as it has them; its notes keep their sentences, under the codes that importers gave them.
io::ImportedAsset imported(io::RiggedShape shape) {
  io::ImportedAsset result;
  if (shape.has_joints()) {
    const std::size_t trees = roots(shape.joints).size();
    result.asset = io::to_asset(shape);
    if (trees > 1)
      result.notes.push_back(
          {"several_roots", std::to_string(trees) + " joint roots: all but the first became its children"});
  } else {
    result.asset.name = shape.id;
    result.asset.mesh = std::move(shape.mesh);
    result.asset.materials = std::move(shape.materials);
    result.asset.images = std::move(shape.images);
  }
  for (const std::string& note : shape.notes) {
    // "a forest of" tells of several_roots again; missing parts stand under `rig`.
    if (note.rfind("no ", 0) == 0 || note.rfind("a forest of ", 0) == 0) continue;
    result.notes.push_back({kPlainNote, note});
  }
  result.lowest_weight_sum = shape.lowest_weight_sum;
  return result;
}

/// @param id of the sample; empty for a file that is one shape
Geometry shape(const fs::path& file, const std::string& id, FileKind kind) {
  const auto source = io::open_meshes(file);
  const std::string wanted = id.empty() ? source->ids().front() : io::sample_called(*source, id, file.string());
  Geometry geometry;
  geometry.imported = imported(source->read(wanted));
  const std::string extension = io::lower_extension(file);
  if (kind == FileKind::kMesh) {
    const bool obj = extension == ".obj";
    if (extension == ".3mf") {  // the reader converts its unit, which such a file always has
      geometry.source = {{"format", "3MF"}, {"axes", "Z up, by the format"}, {"unit", metres(1.0)}};
      return geometry;
    }
    const std::string name = obj ? "OBJ" : extension == ".ply" ? "PLY" : "STL";
    geometry.source = {{"format", name}, {"axes", by_custom(obj ? 'Y' : 'Z')}};
  } else if (kind == FileKind::kTextRig) {
    geometry.source = {{"format", "text rig"}, {"axes", by_custom('Y')}};
  } else if (kind == FileKind::kRigNpz) {
    geometry.source = {{"format", "arrays of a rig"}, {"axes", by_custom('Z')}};
  } else {
    geometry.source = {{"format", source->describe()}};
  }
  geometry.source["unit"] = "not said";
  return geometry;
}

Geometry motion(const fs::path& file) {
  io::require_content(file);
  io::BvhMotion read = io::read_bvh(file);
  Geometry geometry;
  geometry.source = {{"format", "BVH"},
                     {"axes", by_custom('Y')},
                     {"unit", "not said"},
                     {"frames", read.frames},
                     {"frames_per_second", 1.0 / read.frame_time}};
  Asset& asset = geometry.imported.asset;
  asset.name = file.stem().string();
  asset.skeleton = std::move(read.skeleton);
  asset.animations.push_back(std::move(read.animation));
  return geometry;
}

using io::lower_extension;

/// Kinds that an extension tells alone.
const std::map<std::string, FileKind> kByExtension = {
    {".glb", FileKind::kScene},    {".vrm", FileKind::kScene},    {".gltf", FileKind::kScene},
    {".fbx", FileKind::kScene},    {".dae", FileKind::kScene},    {".obj", FileKind::kMesh},
    {".ply", FileKind::kMesh},     {".stl", FileKind::kMesh},     {".3mf", FileKind::kMesh},
    {".bvh", FileKind::kMotion},   {".png", FileKind::kPicture},  {".jpg", FileKind::kPicture},
    {".jpeg", FileKind::kPicture}, {".webp", FileKind::kPicture}, {".bmp", FileKind::kPicture},
    {".tif", FileKind::kPicture},  {".tiff", FileKind::kPicture}, {".safetensors", FileKind::kArrays},
    {".json", FileKind::kConfig}};

FileKind folder_kind(const fs::path& path) {
  std::error_code ignored;
  if (fs::exists(path / "metadata.csv", ignored)) return FileKind::kDataset;
  if (const RunFolder run{path}; run.has_config() || run.has_checkpoints()) return FileKind::kRun;
  return FileKind::kFolder;
}

/// Articulation-XL's list of samples is one member of objects; the stray flag beside it is a number.
FileKind npz_kind(const fs::path& file) {
  io::require_content(file);
  if (io::is_rig_npz(file)) return FileKind::kRigNpz;
  const io::NamedArrays numbers = io::read_npz_headers(file);
  const bool holds_arrays =
      std::any_of(numbers.begin(), numbers.end(), [](const auto& array) { return array.first != "allow_pickle"; });
  return holds_arrays ? FileKind::kArrays : FileKind::kShard;
}

/// Checkpoints are dictionaries of dictionaries, too, but not of joints.
FileKind torch_kind(const fs::path& file) {
  io::require_content(file);
  try {
    const io::AnymateArchive archive(file);
    const io::NamedArrays first = archive.sample(0);
    for (const char* key : {"joints", "bones"}) {
      if (io::find(first, key) != nullptr) return FileKind::kShard;
    }
  } catch (const InputError&) {
    // No list of samples; if it is no checkpoint either, whoever reads it says why.
  }
  return FileKind::kArrays;
}

/// Parts of the pixels, since generation takes a picture's alpha for the outline of its object.
Json alpha_of(const io::Image& image) {
  std::size_t clear = 0, opaque = 0;
  for (std::size_t i = 3; i < image.rgba.size(); i += io::kImageChannels) {
    clear += image.rgba[i] == 0;
    opaque += image.rgba[i] == 255;
  }
  const auto pixels = static_cast<double>(image.rgba.size()) / io::kImageChannels;
  return {{"opaque", static_cast<double>(opaque) / pixels}, {"clear", static_cast<double>(clear) / pixels}};
}

/// Smallest, median and largest of a numeric column; null when it holds no number.
Json column_range(const CsvTable& table, const std::string& name) {
  std::vector<double> values;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    const std::string& cell = table.cell(row, name);
    char* end = nullptr;
    const double value = std::strtod(cell.c_str(), &end);
    if (!cell.empty() && end == cell.c_str() + cell.size()) values.push_back(value);
  }
  if (values.empty()) return nullptr;
  std::sort(values.begin(), values.end());
  return {{"min", values.front()}, {"median", values[values.size() / 2]}, {"max", values.back()}};
}

/// Digits after the last "step" of a checkpoint's name, as the published trainer reads them; -1 without.
long checkpoint_step(const std::string& name) {
  const std::size_t at = name.rfind("step");
  if (at == std::string::npos || at + 4 >= name.size() || name[at + 4] < '0' || name[at + 4] > '9') return -1;
  return std::strtol(name.c_str() + at + 4, nullptr, 10);
}

Json describe_picture(const fs::path& file) {
  io::require_content(file);
  const std::string name = file.string(), text = read_file(file, std::uintmax_t{1} << 30);
  const std::vector<std::uint8_t> bytes(text.begin(), text.end());
  io::StoredPixels stored;
  const io::Image image = io::decode_foreign_image(bytes, name, &stored);
  Json json = {{"format", io::probe_picture(bytes, name).format},
               {"width", image.width},
               {"height", image.height},
               {"channels", stored.channels},
               {"bits", stored.bits}};
  const int orientation = io::exif_orientation(bytes);
  json["orientation"] = orientation;
  if (orientation >= 5) json["upright"] = {{"width", image.height}, {"height", image.width}};
  if (stored.channels == 2 || stored.channels == 4) json["alpha"] = alpha_of(image);
  return json;
}

Json describe_shard(const fs::path& file) {
  const auto source = io::open_source(file);
  const std::vector<std::string> ids = source->ids();
  constexpr std::size_t kShown = 5, kMostRead = 500;
  Json json = {{"holds", source->describe()}, {"samples", ids.size()}};
  json["first_ids"] =
      std::vector<std::string>(ids.begin(), ids.begin() + static_cast<std::ptrdiff_t>(std::min(kShown, ids.size())));
  std::size_t damaged = 0;
  std::vector<std::size_t> joints, vertices;
  for (std::size_t i = 0; i < std::min(ids.size(), kMostRead); ++i) {
    const std::string& id = ids[i];
    try {
      const io::RiggedShape shape = source->read(id);
      joints.push_back(shape.joints.size());
      vertices.push_back(shape.mesh.vertices.size());
    } catch (const InputError&) {
      ++damaged;
    }
  }
  const auto range = [](std::vector<std::size_t>& counts) {
    std::sort(counts.begin(), counts.end());
    return Json{{"min", counts.front()}, {"median", counts[counts.size() / 2]}, {"max", counts.back()}};
  };
  if (ids.size() > kMostRead) json["samples_read"] = kMostRead;
  json["damaged"] = damaged;
  if (!joints.empty()) json["joints_of_samples"] = range(joints);
  if (!vertices.empty()) json["vertices_of_samples"] = range(vertices);
  json["one_of_them"] = "anigen-inspect '" + file.string() + "#" + ids.front() + "'";
  return json;
}

Json describe_arrays(const fs::path& file) {
  const std::string extension = lower_extension(file);
  Json json;
  io::NamedArrays arrays;
  if (extension == ".npz") {
    arrays = io::read_npz_headers(file);
  } else if (extension == ".safetensors") {
    io::SafetensorsFile content = io::read_safetensors(file);
    arrays = std::move(content.tensors);
    json["metadata"] = Json::object();
    for (const auto& [key, value] : content.metadata) json["metadata"][key] = value;
  } else {
    arrays = io::read_torch_archive(file);
  }
  std::size_t numbers = 0;
  Json list = Json::array();
  for (const auto& [name, array] : arrays) {
    numbers += array.count();
    list.push_back({{"name", name}, {"dtype", io::name_of(array.dtype)}, {"shape", array.shape}});
  }
  json["arrays"] = arrays.size();
  json["numbers"] = numbers;
  json["list"] = std::move(list);
  return json;
}

Json describe_config(const fs::path& file) {
  const Json config = read_json(file);
  Json json = Json::object();
  if (!config.is_object()) {
    json["type"] = config.type_name();
    return json;
  }
  const auto name_of_part = [](const Json& part) {
    const auto name = part.is_object() ? part.find("name") : part.end();
    return part.is_object() && name != part.end() && name->is_string() ? name->get<std::string>()
                                                                       : std::string("(unnamed)");
  };
  json["keys"] = Json::array();
  for (const auto& [key, value] : config.items()) json["keys"].push_back(key);
  if (config.contains("models") && config["models"].is_object()) {
    json["models"] = Json::object();
    for (const auto& [key, model] : config["models"].items()) json["models"][key] = name_of_part(model);
  }
  for (const char* part : {"dataset", "trainer"}) {
    if (config.contains(part)) json[part] = name_of_part(config[part]);
  }
  return json;
}

Json describe_dataset(const fs::path& folder) {
  const fs::path file = folder / "metadata.csv";
  const CsvTable table = read_csv(file);
  Json json = {{"rows", table.rows.size()}, {"columns", table.columns}};
  std::map<std::string, std::size_t> sources;
  for (std::size_t row = 0; row < table.rows.size(); ++row) ++sources[table.cell(row, "source")];
  if (table.column("source") != CsvTable::kMissing) json["sources"] = sources;
  for (const char* name :
       {"is_test", "is_bad_skeleton", "is_bad_skin", "distinct_bones", "voxelized", "cond_rendered"}) {
    if (table.column(name) == CsvTable::kMissing) continue;
    std::size_t set = 0;
    for (std::size_t row = 0; row < table.rows.size(); ++row) set += table.flag(row, name, false, file.string());
    json[name] = set;
  }
  for (const char* name : {"num_joints", "num_vertices", "num_faces", "max_influences", "num_voxels"}) {
    if (table.column(name) != CsvTable::kMissing) json[name] = column_range(table, name);
  }
  json["files"] = Json::object();
  for (const char* part :
       {"skeleton", "assets", "voxels", "features", "renders", "renders_cond", "ss_latents", "latents"}) {
    std::error_code error;
    std::size_t entries = 0;
    for (fs::directory_iterator entry(folder / part, error), end; !error && entry != end; entry.increment(error))
      ++entries;
    if (entries > 0) json["files"][part] = entries;
  }
  return json;
}

Json describe_run(const fs::path& folder) {
  Json json = Json::object();
  std::error_code error;
  const RunFolder run{folder};
  if (run.has_config()) json.update(describe_config(run.config()));
  std::set<long> steps;
  std::set<std::string> names;
  for (fs::directory_iterator entry(run.checkpoints(), error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    names.insert(name);
    if (checkpoint_step(name) >= 0) steps.insert(checkpoint_step(name));
  }
  json["checkpoint_steps"] = steps;
  json["checkpoint_files"] = names;
  if (fs::exists(run.metrics(), error)) {
    const CsvTable metrics = read_csv(run.metrics());
    json["metrics_rows"] = metrics.rows.size();
    if (!metrics.rows.empty()) {
      json["last_metrics"] = Json::object();
      for (std::size_t i = 0; i < metrics.columns.size(); ++i)
        json["last_metrics"][metrics.columns[i]] = metrics.rows.back()[i];
    }
  }
  return json;
}

Json describe_folder(const fs::path& folder) {
  std::map<std::string, std::size_t> counts;
  for (const fs::path& file : io::files_below(
           folder, {".glb", ".gltf", ".vrm",         ".fbx", ".dae", ".obj",  ".ply",  ".stl", ".3mf", ".bvh", ".npz",
                    ".pt",  ".pth",  ".safetensors", ".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff"}))
    ++counts[io::lower_extension(file)];
  std::size_t rigs = 0;
  for (const fs::path& file : io::files_below(folder, {".txt"})) rigs += io::is_text_rig(file);
  if (counts.empty() && rigs == 0) {
    throw InputError(
        folder.string(), "",
        "is neither a dataset (metadata.csv) nor a run folder (config.json, ckpts), and holds no file that "
        "can be read");
  }
  Json json = {{"files", counts}};
  if (rigs > 0) json["text_rigs"] = rigs;
  return json;
}

}  // namespace

Geometry read_geometry(const fs::path& path, FileKind kind) {
  if (kind == FileKind::kScene) return scene(path);
  if (kind == FileKind::kMotion) return motion(path);
  if (kind == FileKind::kMesh || kind == FileKind::kTextRig || kind == FileKind::kRigNpz) return shape(path, "", kind);
  const auto sample = kind == FileKind::kSample ? io::sample_of(path) : std::nullopt;
  if (sample) return shape(sample->first, sample->second, kind);
  throw InputError(path.string(), "", "holds no mesh and no skeleton");
}

FileKind file_kind(const fs::path& path) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) {
    if (io::sample_of(path)) return FileKind::kSample;
    throw InputError(path.string(), "", "no such file or folder");
  }
  if (fs::is_directory(path, ignored)) return folder_kind(path);
  const std::string extension = lower_extension(path);
  if (const auto known = kByExtension.find(extension); known != kByExtension.end()) return known->second;
  if (extension == ".npz") return npz_kind(path);
  if (extension == ".pt" || extension == ".pth") return torch_kind(path);
  if (extension == ".txt") {
    if (io::is_text_rig(path)) return FileKind::kTextRig;
    throw InputError(path.string(), "", "is no text rig: its first word is none of joints, root, hier, skin");
  }
  throw InputError(
      path.string(), "",
      "is none of .glb .gltf .fbx .dae .obj .ply .stl .3mf .bvh .txt .npz .pt .pth .safetensors .json .png .jpg "
      ".jpeg .webp .bmp .tif .tiff");
}

bool is_geometry(FileKind kind) {
  return kind == FileKind::kScene || kind == FileKind::kMesh || kind == FileKind::kTextRig ||
         kind == FileKind::kRigNpz || kind == FileKind::kSample || kind == FileKind::kMotion;
}

Json inspect(const fs::path& path) {
  using Describe = Json (*)(const fs::path&);
  static const std::map<FileKind, std::pair<const char*, Describe>> kDescribed = {
      {FileKind::kPicture, {"picture", describe_picture}}, {FileKind::kShard, {"shard", describe_shard}},
      {FileKind::kArrays, {"arrays", describe_arrays}},    {FileKind::kConfig, {"config", describe_config}},
      {FileKind::kDataset, {"dataset", describe_dataset}}, {FileKind::kRun, {"run", describe_run}},
      {FileKind::kFolder, {"folder", describe_folder}}};
  const FileKind kind = file_kind(path);
  if (is_geometry(kind)) return describe_geometry(path, read_geometry(path, kind));
  const auto& [name, describe] = kDescribed.at(kind);
  Json json = {{"file", path.string()}, {"kind", name}};
  json.update(describe(path));
  return json;
}

}  // namespace anigen::eval
