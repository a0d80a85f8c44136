#include <algorithm>
#include <cstdlib>
#include <map>
#include <set>

#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "anigen/eval/inspect/inspect.h"
#include "anigen/io/rigs/file_list.h"
#include "anigen/io/rigs/text_rig.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

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

}  // namespace

Json describe_folder(const fs::path& folder) {
  std::map<std::string, std::size_t> counts;
  for (const fs::path& file :
       io::files_below(folder, {".glb", ".gltf", ".fbx", ".dae", ".obj", ".ply", ".stl", ".bvh", ".npz", ".pt", ".pth",
                                ".safetensors", ".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff"}))
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
  if (fs::exists(folder / "config.json", error)) json.update(describe_config(folder / "config.json"));
  std::set<long> steps;
  std::set<std::string> names;
  for (fs::directory_iterator entry(folder / "ckpts", error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    names.insert(name);
    if (checkpoint_step(name) >= 0) steps.insert(checkpoint_step(name));
  }
  json["checkpoint_steps"] = steps;
  json["checkpoint_files"] = names;
  if (fs::exists(folder / "metrics.csv", error)) {
    const CsvTable metrics = read_csv(folder / "metrics.csv");
    json["metrics_rows"] = metrics.rows.size();
    if (!metrics.rows.empty()) {
      json["last_metrics"] = Json::object();
      for (std::size_t i = 0; i < metrics.columns.size(); ++i)
        json["last_metrics"][metrics.columns[i]] = metrics.rows.back()[i];
    }
  }
  return json;
}

}  // namespace anigen::eval
