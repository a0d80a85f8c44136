#include "anigen/train/export_run.h"

#include <algorithm>
#include <cstdio>
#include <system_error>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/run_folder.h"
#include "anigen/io/arrays/row_quantization.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/state_dict.h"

namespace anigen::train {

namespace {

namespace fs = std::filesystem;

// A model that trains beside those of the config.
constexpr const char* kImageEncoder = "image_encoder";

// Folders of other runs by their last part; nothing that is only here.
void make_portable(Json& config) {
  const auto by_name = [&config](const char* pointer) {
    const Json::json_pointer at(pointer);
    if (!config.contains(at) || !config[at].is_string()) return;
    const std::string text = config[at].get<std::string>();
    if (!text.empty()) config[at] = (fs::path(text) / "x").parent_path().filename().string();
  };
  for (const char* pointer : {"/dataset/args/ss_dec_path", "/dataset/args/slat_dec_path", "/dataset/args/pictures",
                              "/dataset/args/backgrounds", "/dataset/args/cache", "/trainer/args/skin_ae_run",
                              "/trainer/args/image_encoder/estimator", "/trainer/args/image_encoder/flow"})
    by_name(pointer);
  if (!config.contains("dataset") || !config["dataset"].contains("args")) return;
  Json& reading = config["dataset"]["args"];
  reading.erase("data_dir");
  for (const char* key : {"split", "eval_split"}) {
    if (!reading.contains(key) || !reading[key].is_string()) continue;
    const fs::path file = reading[key].get<std::string>();
    if (file.is_absolute()) reading[key] = "splits/" + file.filename().string();
  }
  // Said aloud, since a flow without training state and without this key counts as published, which sees normals.
  const bool pictures = config["dataset"].value("name", "").find("ImageConditioned") != std::string::npos;
  if (pictures && !reading.contains("condition")) reading["condition"] = "color";
}

}  // namespace

ExportedRun export_run(const fs::path& run, const fs::path& folder, ExportPrecision precision) {
  const RunFolder from{run}, to{folder / (run / "x").parent_path().filename()};
  std::error_code error;
  if (fs::equivalent(from.root, to.root, error))
    throw InputError(to.root.string(), "--export", "is the run itself; name another folder");
  Json config = read_json(from.config());
  ExportedRun exported;
  for (const auto& [name, model] : config.at("models").items()) {
    static_cast<void>(model);
    exported.models.push_back(name);
  }
  for (const std::string& name : io::checkpoint_names(from.checkpoints())) {
    if (name.rfind(std::string(kImageEncoder) + "_", 0) != 0) continue;
    exported.models.emplace_back(kImageEncoder);
    break;
  }
  std::vector<std::pair<std::string, io::NamedArrays>> files;
  for (const std::string& model : exported.models) {
    const fs::path file = nn::newest_checkpoint(run, model);
    io::NamedArrays arrays = io::read_state_dict(file);
    for (auto& [name, array] : arrays) {
      exported.parameters += array.count();
      if (precision == ExportPrecision::kHalf) array = io::halved(array, file.string(), name);
    }
    if (precision == ExportPrecision::kInt8) arrays = io::quantize_rows(arrays, file.string());
    const std::int64_t step = std::max<std::int64_t>(0, io::step_of(file.filename().string()));
    exported.step = std::max(exported.step, step);
    char name[32];
    std::snprintf(name, sizeof name, "_step%07lld", static_cast<long long>(step));
    files.emplace_back(model + name + ".safetensors", std::move(arrays));
  }
  make_folders(to.checkpoints());
  for (const auto& [name, arrays] : files) {
    io::write_safetensors(to.checkpoints() / name, arrays);
    exported.bytes += fs::file_size(to.checkpoints() / name, error);
  }
  constexpr const char* kGrouping = "grouping.json";
  if (fs::is_regular_file(run / kGrouping, error))
    write_file_atomically(to.root / kGrouping, read_file(run / kGrouping));
  make_portable(config);
  write_file_atomically(to.config(), config.dump(2) + "\n");
  return exported;
}

}  // namespace anigen::train
