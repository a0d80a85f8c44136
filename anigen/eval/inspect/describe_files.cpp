#include <algorithm>
#include <cctype>

#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/eval/inspect/inspect.h"
#include "anigen/io/npz.h"
#include "anigen/io/safetensors.h"
#include "anigen/io/torch_archive.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

std::string lower_extension(const fs::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

}  // namespace

FileKind file_kind(const fs::path& path) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) throw InputError(path.string(), "", "no such file or folder");
  if (fs::is_directory(path, ignored)) {
    if (fs::exists(path / "metadata.csv", ignored)) return FileKind::kDataset;
    if (fs::exists(path / "config.json", ignored) || fs::is_directory(path / "ckpts", ignored)) return FileKind::kRun;
    throw InputError(path.string(), "", "is neither a dataset (metadata.csv) nor a run folder (config.json, ckpts)");
  }
  const std::string extension = lower_extension(path);
  if (extension == ".glb" || extension == ".gltf") return FileKind::kAsset;
  if (extension == ".npz" || extension == ".safetensors" || extension == ".pt" || extension == ".pth")
    return FileKind::kArrays;
  if (extension == ".json") return FileKind::kConfig;
  throw InputError(path.string(), "", "is none of .glb .gltf .npz .safetensors .pt .pth .json");
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
  Json json = {{"file", path.string()}};
  const auto add = [&json](const char* kind, Json description) {
    json["kind"] = kind;
    json.update(description);
  };
  switch (file_kind(path)) {
    case FileKind::kAsset:
      add("asset", describe_asset(io::read_gltf(path)));
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
  }
  return json;
}

}  // namespace anigen::eval
