#include <algorithm>
#include <array>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/eval/inspect/inspect.h"
#include "anigen/io/image.h"
#include "anigen/io/image_orientation.h"
#include "anigen/io/npz.h"
#include "anigen/io/picture_bytes.h"
#include "anigen/io/rigs/anymate_archive.h"
#include "anigen/io/rigs/file_list.h"
#include "anigen/io/rigs/rig_arrays.h"
#include "anigen/io/rigs/text_rig.h"
#include "anigen/io/safetensors.h"
#include "anigen/io/tiff_directory.h"
#include "anigen/io/torch_archive.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

using io::lower_extension;

/// Kinds that an extension tells alone.
constexpr std::array<std::pair<const char*, FileKind>, 17> kByExtension = {{{".glb", FileKind::kScene},
                                                                            {".gltf", FileKind::kScene},
                                                                            {".fbx", FileKind::kScene},
                                                                            {".dae", FileKind::kScene},
                                                                            {".obj", FileKind::kMesh},
                                                                            {".ply", FileKind::kMesh},
                                                                            {".stl", FileKind::kMesh},
                                                                            {".bvh", FileKind::kMotion},
                                                                            {".png", FileKind::kPicture},
                                                                            {".jpg", FileKind::kPicture},
                                                                            {".jpeg", FileKind::kPicture},
                                                                            {".webp", FileKind::kPicture},
                                                                            {".bmp", FileKind::kPicture},
                                                                            {".tif", FileKind::kPicture},
                                                                            {".tiff", FileKind::kPicture},
                                                                            {".safetensors", FileKind::kArrays},
                                                                            {".json", FileKind::kConfig}}};

FileKind folder_kind(const fs::path& path) {
  std::error_code ignored;
  if (fs::exists(path / "metadata.csv", ignored)) return FileKind::kDataset;
  if (fs::exists(path / "config.json", ignored) || fs::is_directory(path / "ckpts", ignored)) return FileKind::kRun;
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

}  // namespace

std::optional<std::pair<fs::path, std::string>> sample_of(const fs::path& path) {
  const std::string text = path.string();
  std::error_code ignored;
  if (fs::exists(path, ignored)) return std::nullopt;
  // Ids may hold the sign, too.
  for (std::size_t sign = text.find('#'); sign != std::string::npos; sign = text.find('#', sign + 1)) {
    if (fs::exists(text.substr(0, sign), ignored))
      return std::pair{fs::path(text.substr(0, sign)), text.substr(sign + 1)};
  }
  return std::nullopt;
}

FileKind file_kind(const fs::path& path) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) {
    if (sample_of(path)) return FileKind::kSample;
    throw InputError(path.string(), "", "no such file or folder");
  }
  if (fs::is_directory(path, ignored)) return folder_kind(path);
  const std::string extension = lower_extension(path);
  for (const auto& [known, kind] : kByExtension) {
    if (extension == known) return kind;
  }
  if (extension == ".npz") return npz_kind(path);
  if (extension == ".pt" || extension == ".pth") return torch_kind(path);
  if (extension == ".txt") {
    if (io::is_text_rig(path)) return FileKind::kTextRig;
    throw InputError(path.string(), "", "is no text rig: its first word is none of joints, root, hier, skin");
  }
  throw InputError(
      path.string(), "",
      "is none of .glb .gltf .fbx .dae .obj .ply .stl .bvh .txt .npz .pt .pth .safetensors .json .png .jpg "
      ".jpeg .webp .bmp .tif .tiff");
}

bool is_geometry(FileKind kind) {
  switch (kind) {
    case FileKind::kScene:
    case FileKind::kMesh:
    case FileKind::kTextRig:
    case FileKind::kRigNpz:
    case FileKind::kSample:
    case FileKind::kMotion:
      return true;
    default:
      return false;
  }
}

namespace {

const char* picture_format(const io::PictureBytes& in) {
  if (in.matches(0, io::kPngSignature)) return "PNG";
  if (in.matches(0, io::kJpegSignature)) return "JPEG";
  if (in.matches(0, "BM")) return "BMP";
  if (in.matches(0, "RIFF") && in.matches(8, "WEBP")) return "WebP";
  return io::is_tiff(in, 0) ? "TIFF" : "another format";
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

}  // namespace

Json describe_picture(const fs::path& file) {
  io::require_content(file);
  const std::string name = file.string(), text = read_file(file, std::uintmax_t{1} << 30);
  const std::vector<std::uint8_t> bytes(text.begin(), text.end());
  io::StoredPixels stored;
  const io::Image image = io::decode_image(bytes, name, &stored);
  Json json = {{"format", picture_format(io::PictureBytes(bytes, name))},
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

Json inspect(const fs::path& path) {
  const FileKind kind = file_kind(path);
  if (is_geometry(kind)) return describe_geometry(path, read_geometry(path, kind));
  Json json = {{"file", path.string()}};
  const auto add = [&json](const char* name, Json description) {
    json["kind"] = name;
    json.update(description);
  };
  switch (kind) {
    case FileKind::kPicture:
      add("picture", describe_picture(path));
      break;
    case FileKind::kShard:
      add("shard", describe_shard(path));
      break;
    case FileKind::kArrays:
      add("arrays", describe_arrays(path));
      break;
    case FileKind::kConfig:
      add("config", describe_config(path));
      break;
    case FileKind::kDataset:
      add("dataset", describe_dataset(path));
      break;
    case FileKind::kRun:
      add("run", describe_run(path));
      break;
    case FileKind::kFolder:
      add("folder", describe_folder(path));
      break;
    default:
      break;
  }
  return json;
}

}  // namespace anigen::eval
