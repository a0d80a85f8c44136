#include "anigen/io/rigs/rig_reader.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <map>
#include <utility>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/log.h"
#include "anigen/core/text.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/mtl.h"
#include "anigen/io/ply.h"
#include "anigen/io/rigs/anymate.h"
#include "anigen/io/rigs/articulation_xl.h"
#include "anigen/io/rigs/read_assimp.h"
#include "anigen/io/rigs/rig_arrays.h"
#include "anigen/io/rigs/samples.h"
#include "anigen/io/rigs/text_rig.h"
#include "anigen/io/stl.h"
#include "anigen/io/three_mf.h"

namespace anigen::io {

std::string content_id(NamedArrays arrays) {
  std::sort(arrays.begin(), arrays.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  Sha256 digest;
  for (const auto& [name, array] : arrays) {
    std::string header = name + '\0' + name_of(array.dtype);
    for (const std::int64_t size : array.shape) header += ' ' + std::to_string(size);
    digest.update(header + '\0');
    digest.update({reinterpret_cast<const char*>(array.bytes.data()), array.bytes.size()});
  }
  return digest.finish();
}

namespace fs = std::filesystem;

namespace {

const std::vector<std::string> kMeshExtensions = {".obj", ".ply", ".stl", ".3mf"};
const std::vector<std::string> kRiggedExtensions = {".glb", ".gltf", ".fbx", ".dae", ".npz", ".pt", ".pth"};

RiggedShape read_mesh_shape(const fs::path& file, const std::string& id, Axes axes) {
  require_content(file);
  RiggedShape shape(id, file.string());
  const std::string extension = lower_extension(file);
  const bool obj = extension == ".obj";
  if (obj) {
    PaintedMesh painted = read_painted_obj(file);
    shape.mesh = std::move(painted.mesh);
    shape.materials = std::move(painted.materials);
    shape.images = std::move(painted.images);
    shape.notes = std::move(painted.notes);
    for (const std::string& note : shape.notes) log::warn("{}: {}", file.string(), note);
  } else {
    shape.mesh = extension == ".ply" ? read_ply(file) : extension == ".3mf" ? read_three_mf(file) : read_stl(file);
  }
  turn_to_z_up(shape, axes, obj ? Axes::kYUp : Axes::kZUp);
  return shape;
}

bool holds_rigs(const fs::path& folder) {
  if (fs::exists(folder / "metadata.csv") || !files_below(folder, kRiggedExtensions).empty()) return true;
  const std::vector<fs::path> texts = files_below(folder, {".txt"});
  return std::any_of(texts.begin(), texts.end(), is_text_rig);
}

}  // namespace

std::unique_ptr<ShapeSource> open_meshes(const fs::path& path, const SourceOptions& wanted) {
  SourceOptions options = wanted;
  options.require_rig = false;
  std::error_code error;
  const bool folder = fs::is_directory(path, error);
  if (folder ? holds_rigs(path) : !has_extension(path, kMeshExtensions)) return open_source(path, options);
  const Axes axes = options.axes;
  const auto reader = [axes](const fs::path& file, const std::string& id) { return read_mesh_shape(file, id, axes); };
  if (!folder) {
    std::vector<FileListSource::Entry> entries = {{path.stem().string(), path}};
    return std::make_unique<FileListSource>(std::move(entries), reader, "mesh " + path.string(), true);
  }
  const std::vector<fs::path> files = files_below(path, kMeshExtensions);
  if (files.empty()) return open_source(path, options);  // which says what it looked for
  return std::make_unique<FileListSource>(entries_below(path, files), reader,
                                          std::to_string(files.size()) + " meshes in " + path.string(), false);
}

namespace {

const std::vector<std::string> kSceneExtensions = {".glb", ".gltf", ".fbx", ".dae"};

/// A format of files that hold one rig each.
struct Format {
  const char* name;
  RiggedShape (*read)(const fs::path& file, const std::string& id, const SourceOptions& options);
};
constexpr Format kScene = {"rigged file",
                           [](const fs::path& file, const std::string& id, const SourceOptions& options) {
                             return read_scene_shape(file, id, options.axes, options.require_rig);
                           }};
constexpr Format kRigNpz = {"NPZ rig", [](const fs::path& file, const std::string& id, const SourceOptions& options) {
                              RiggedShape shape = read_rig_npz(file, id);
                              turn_to_z_up(shape, options.axes, Axes::kZUp);
                              return shape;
                            }};
constexpr Format kTextRig = {"text rig", [](const fs::path& file, const std::string& id, const SourceOptions& options) {
                               return read_text_rig(file, id, options.axes);
                             }};

FileListSource::Reader reader(const Format& format, const SourceOptions& options) {
  return [read = format.read, options](const fs::path& file, const std::string& id) { return read(file, id, options); };
}

/// Files that carry one name in every folder say who they are by the folder.
std::string id_of_single(const fs::path& file) {
  const std::string stem = file.stem().string();
  const std::string folder = fs::absolute(file).parent_path().filename().string();
  return (stem == "raw_data" || stem == "skeleton_voxelized") && !folder.empty() ? folder : stem;
}

std::unique_ptr<ShapeSource> single(const fs::path& file, const Format& format, const SourceOptions& options) {
  std::vector<FileListSource::Entry> entries = {{id_of_single(file), file}};
  return std::make_unique<FileListSource>(std::move(entries), reader(format, options),
                                          std::string(format.name) + " " + file.string(), true);
}

std::string counted(std::size_t count, const std::string& name) {
  return std::to_string(count) + " " + name + (count == 1 ? "" : "s");
}

std::unique_ptr<ShapeSource> open_npz(const fs::path& file, const SourceOptions& options) {
  require_content(file);
  if (is_rig_npz(file)) return single(file, kRigNpz, options);
  return open_articulation_xl(file, options);
}

/// A file that holds one rig, by its extension. Any other .npz says what is wrong with it.
constexpr Format kAnyRig = {"rig", [](const fs::path& file, const std::string& id, const SourceOptions& options) {
                              const std::string extension = lower_extension(file);
                              if (extension == ".txt") return kTextRig.read(file, id, options);
                              if (extension != ".npz") return kScene.read(file, id, options);
                              if (is_rig_npz(file)) return kRigNpz.read(file, id, options);
                              const std::unique_ptr<ShapeSource> shard = open_articulation_xl(file, options);
                              return shard->read(shard->ids().front());
                            }};

std::unique_ptr<ShapeSource> open_file(const fs::path& file, const SourceOptions& options) {
  const std::string extension = lower_extension(file);
  if (has_extension(file, kSceneExtensions)) return single(file, kScene, options);
  if (extension == ".txt") return single(file, kTextRig, options);
  if (extension == ".npz") return open_npz(file, options);
  if (extension == ".pt" || extension == ".pth") return open_anymate({file}, options, true);
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

/// Of a folder's NPZ files those with many samples, opened; the others stay in the list. A damaged one is a rig that
/// cannot be read: it hides nothing else.
std::vector<std::unique_ptr<ShapeSource>> take_shards(std::vector<fs::path>& files, const SourceOptions& options) {
  std::vector<std::unique_ptr<ShapeSource>> shards;
  const auto is_shard = [&](const fs::path& file) {
    try {
      if (is_rig_npz(file)) return false;
      shards.push_back(open_articulation_xl(file, options));
      return true;
    } catch (const InputError&) {
      return false;
    }
  };
  files.erase(std::remove_if(files.begin(), files.end(), is_shard), files.end());
  return shards;
}

std::unique_ptr<ShapeSource> open_folder(const fs::path& folder, const SourceOptions& options) {
  if (fs::exists(folder / "metadata.csv") && fs::is_directory(folder / "skeleton"))
    return std::make_unique<DatasetSource>(folder, options);
  const std::vector<fs::path> scenes = without_companions(files_below(folder, kSceneExtensions));
  std::vector<fs::path> npz = files_below(folder, {".npz"});
  npz.erase(std::remove_if(npz.begin(), npz.end(), is_beside_report), npz.end());  // latents
  const std::vector<fs::path> torch = files_below(folder, {".pt", ".pth"});
  std::vector<fs::path> text = files_below(folder, {".txt"});
  text.erase(std::remove_if(text.begin(), text.end(), std::not_fn(is_text_rig)), text.end());
  std::vector<fs::path> raw_data;
  std::copy_if(npz.begin(), npz.end(), std::back_inserter(raw_data),
               [](const fs::path& file) { return file.filename() == "raw_data.npz"; });
  if (!raw_data.empty()) npz = raw_data;
  std::vector<std::unique_ptr<ShapeSource>> parts = take_shards(npz, options);
  const bool has_shards = !parts.empty();

  std::vector<std::string> found;
  std::vector<fs::path> singles;
  const auto add = [&](const std::vector<fs::path>& files, const Format& format) {
    if (!files.empty()) found.push_back(counted(files.size(), format.name));
    singles.insert(singles.end(), files.begin(), files.end());
  };
  add(scenes, kScene);
  add(npz, kRigNpz);
  add(text, kTextRig);
  if (has_shards) found.push_back(counted(parts.size(), "Articulation-XL file"));
  if (!torch.empty()) {
    found.push_back(counted(torch.size(), "Anymate file"));
    parts.push_back(open_anymate(torch, options, false));
  }
  if (found.empty()) {
    throw InputError(
        folder.string(), "",
        "holds nothing that can be read: no .glb, .gltf, .fbx, .dae, .npz, .pt, text rig, or metadata.csv with "
        "skeleton/");
  }
  const std::string description = joined(found) + " in " + folder.string();
  if (!singles.empty()) {
    std::sort(singles.begin(), singles.end());
    parts.insert(parts.begin(), std::make_unique<FileListSource>(entries_below(folder, singles),
                                                                 reader(kAnyRig, options), description, false));
  }
  return parts.size() == 1 && !has_shards ? std::move(parts.front()) : joined_sources(std::move(parts), description);
}

}  // namespace

std::unique_ptr<ShapeSource> open_source(const fs::path& path, const SourceOptions& options) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) {
    const auto sample = sample_of(path);
    if (!sample) throw InputError(path.string(), "", "there is no such file or folder");
    std::unique_ptr<ShapeSource> source = open_source(sample->first, options);
    const std::string id = sample_called(*source, sample->second, sample->first.string());
    return single_sample(std::move(source), id);
  }
  return fs::is_directory(status) ? open_folder(path, options) : open_file(path, options);
}

namespace {

/// sha256 of a .gltf followed by its external buffers in order.
std::string gltf_content_id(const std::filesystem::path& file) {
  const ImportOptions limits;
  const std::string text = read_file(file, limits.max_file_bytes);
  Sha256 digest;
  digest.update(text);
  const Json json = parse_json(text, file.string(), JsonLimits{limits.max_json_depth});
  const auto buffers = json.is_object() ? json.find("buffers") : json.end();
  if (buffers == json.end() || !buffers->is_array()) return digest.finish();
  for (std::size_t i = 0; i < buffers->size(); ++i) {
    const Json& buffer = (*buffers)[i];
    if (!buffer.is_object() || !buffer.contains("uri") || !buffer["uri"].is_string()) continue;
    const std::string uri = buffer["uri"].get<std::string>();
    if (gltf_import::is_data_uri(uri)) continue;
    const std::string pointer = "/buffers/" + std::to_string(i) + "/uri";
    const std::filesystem::path buffered = gltf_import::path_of_uri(uri, file.parent_path(), file.string(), pointer);
    digest.update(read_file(buffered, limits.max_file_bytes));
  }
  return digest.finish();
}

fs::path file_of(const RigEntry& entry) {
  return entry.format == RigFormat::kDataset ? entry.file / "skeleton" / entry.key / "skeleton_voxelized.npz"
                                             : entry.file;
}

bool is_sample(const RigEntry& entry) {
  return entry.format == RigFormat::kArticulationXl || entry.format == RigFormat::kAnymate;
}

std::size_t repeated_names(const std::vector<std::string>& names) {
  const std::set<std::string> different(names.begin(), names.end());
  return names.size() - different.size();
}

/// Parts that an asset cannot be without, and the repairs as notes of the importers.
ImportedAsset asset_of(RiggedShape shape) {
  const auto refuse = [&shape](const std::string& problem) {
    throw InputError(shape.file, shape.id.empty() ? "" : "sample " + shape.id, problem);
  };
  if (!shape.has_surface()) refuse("has no mesh with faces");
  if (!shape.has_joints()) refuse("has no skeleton");
  if (!shape.has_skin()) refuse("has no skin weights");
  ImportedAsset imported;
  imported.lowest_weight_sum = shape.lowest_weight_sum;
  const auto tally = [&imported](const std::string& code, std::size_t count, const std::string& what) {
    if (count > 0) imported.notes.push_back({code, std::to_string(count) + " " + what});
  };
  tally("zero_weights", shape.unweighted, "vertices had no weight and were bound to the root");
  tally("unnormalised_weights", shape.not_whole.size() - shape.unweighted,
        "vertices had weights that did not sum to 1 and were divided by their sum");
  tally("duplicate_joint_names", repeated_names(shape.joint_names), "joints had the name of an earlier one");
  const std::size_t trees = anigen::roots(shape.joints).size();
  if (trees > 1) tally("several_roots", trees, "joint roots: all but the first became its children");
  imported.asset = to_asset(shape);
  imported.asset.name = shape.id;
  const std::vector<std::string> findings = validate(imported.asset, 1);
  if (!findings.empty()) refuse("cannot be made a sound asset: " + findings.front());
  return imported;
}

NamedArrays plain_arrays(const fs::path& file) {
  require_content(file);
  NamedArrays arrays;
  for (const auto& [name, header] : read_npz_headers(file)) {
    for (const char* wanted : {"joints", "parents", "skin", "vertices", "faces", "vertex_normals"}) {
      if (name == wanted) arrays.push_back(std::move(read_npz(file, {name}).front()));
    }
  }
  return arrays;
}

}  // namespace

std::shared_ptr<const ShapeSource> RigReader::shard(const RigEntry& entry) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (open_shard_ == nullptr || open_file_ != entry.file) {
    open_shard_.reset();  // before another one is read: two may not fit in memory
    SourceOptions options;
    options.content_ids = true;
    require_content(entry.file);
    if (entry.format == RigFormat::kAnymate)
      open_shard_ = open_anymate({entry.file}, options, false);
    else
      open_shard_ = open_articulation_xl(entry.file, options);
    open_file_ = entry.file;
  }
  return open_shard_;
}

ImportedAsset RigReader::read(const RigEntry& entry) const {
  if (is_sample(entry)) return asset_of(shard(entry)->read(entry.key));
  const fs::path file = file_of(entry);
  require_content(file);
  if (entry.format == RigFormat::kGltf) return read_gltf(file);
  if (entry.format == RigFormat::kAssimp) return read_assimp(file);
  if (entry.format == RigFormat::kTextRig) return asset_of(read_text_rig(file, file.stem().string()));
  return asset_of(read_rig_npz(file, entry.format == RigFormat::kDataset ? entry.key : file.stem().string()));
}

std::string RigReader::content_id(const RigEntry& entry) const {
  if (is_sample(entry)) return shard(entry)->sample_id(entry.key);
  const fs::path file = file_of(entry);
  if (entry.format == RigFormat::kRigArrays || entry.format == RigFormat::kDataset)
    return io::content_id(plain_arrays(file));
  if (entry.format == RigFormat::kGltf && lower_extension(file) == ".gltf") return gltf_content_id(file);
  const ImportOptions limits;
  Sha256 digest;
  digest.update(read_file(file, limits.max_file_bytes));
  const fs::path mesh = entry.format == RigFormat::kTextRig ? mesh_of_text_rig(file) : fs::path();
  if (!mesh.empty()) digest.update(read_file(mesh, limits.max_file_bytes));
  return digest.finish();
}

std::string pictures_id(const RigEntry& entry) {
  if (entry.format != RigFormat::kGltf && entry.format != RigFormat::kAssimp) return "";
  const ImportOptions limits;
  std::map<std::string, std::string> contents;
  for (const fs::path& file : files_read_with(entry.file)) {
    if (!has_extension(file, {".png", ".jpg", ".jpeg", ".webp", ".tga", ".bmp", ".gif", ".tif", ".tiff", ".mtl"}))
      continue;
    try {
      contents[file.lexically_relative(entry.file.parent_path()).generic_string()] =
          sha256(read_file(file, limits.max_file_bytes));
    } catch (const Error&) {  // it is not there, or cannot be read: so it has no part in what is made
    }
  }
  if (contents.empty()) return "";
  Sha256 digest;
  for (const auto& [name, content] : contents) digest.update(name + "\n" + content + "\n");
  return digest.finish();
}

}  // namespace anigen::io
