#include "anigen/loaders/source_options.h"

#include <filesystem>
#include <set>
#include <system_error>

#include "anigen/core/random.h"

namespace anigen::loaders {
namespace {

namespace fs = std::filesystem;

double place_of(const std::string& id) { return static_cast<double>(stable_hash(id) >> 11) * 0x1.0p-53; }

}  // namespace

fs::path file_of_dataset(const std::string& name, const std::string& data_dir) {
  const fs::path below_root = fs::path(data_dir.substr(0, data_dir.find(','))) / name;
  std::error_code error;
  return fs::exists(below_root, error) ? below_root : fs::path(name);
}

void SourceOptions::read_common(ConfigReader& reader) {
  data_dir = reader.text("data_dir", "");
  split = reader.text("split", "");
  eval_split = reader.text("eval_split", "");
  eval_fraction = reader.number("eval_fraction", 0.0, 0.0, 0.9);
  train_share = reader.number("train_share", 1.0, 0.0, 1.0);
  skip_broken = reader.boolean("skip_broken", false);
  filter.min_aesthetic_score = reader.number("min_aesthetic_score", 5.0);
  if (const Json* listed = reader.raw("instances"); listed != nullptr && !listed->is_null()) {
    const std::vector<std::string> ids = reader.texts("instances", {});
    filter.instances = std::set<std::string>(ids.begin(), ids.end());
  }
  ConfigReader repeat = reader.object("repeat_sources");
  if (const Json* sources = reader.raw("repeat_sources"); sources != nullptr && sources->is_object()) {
    for (const auto& source : sources->items()) {
      filter.repeat[source.key()] = static_cast<std::size_t>(repeat.integer(source.key(), 1, 1, 10000));
    }
  }
  repeat.finish();
}

TrainAndEval select(const SourceOptions& options) {
  RowFilter filter = options.filter;
  TrainAndEval result;
  std::set<std::string> held_out;
  if (!options.eval_split.empty()) {
    held_out = read_split(file_of_dataset(options.eval_split, options.data_dir), options.data_dir);
    RowFilter evaluated = filter;
    evaluated.only = held_out;
    evaluated.repeat.clear();
    result.eval = select_assets(options.data_dir, evaluated);
  }
  if (!options.split.empty())
    filter.only = read_split(file_of_dataset(options.split, options.data_dir), options.data_dir);
  for (const AssetId& asset : select_assets(options.data_dir, filter)) {
    if (held_out.count(asset.id) > 0) continue;
    const bool chosen = options.eval_split.empty() && place_of(asset.id) < options.eval_fraction;
    // Another hash than that of eval_fraction, so that the two do not choose alike.
    if (!chosen && options.train_share < 1.0 && place_of("share " + asset.id) >= options.train_share) continue;
    (chosen ? result.eval : result.train).push_back(asset);
    if (chosen) result.eval.back().repeat = 1;
  }
  if (result.train.empty()) {
    throw InputError(options.data_dir, "split",
                     options.train_share < 1.0 ? "train_share leaves no asset to train on"
                                               : "every asset is held out for evaluation; none is left to train on");
  }
  if (options.eval_fraction > 0.0 && result.eval.empty()) {
    throw InputError(options.data_dir, "eval_fraction",
                     "holds out none of " + std::to_string(result.train.size()) + " assets");
  }
  return result;
}

}  // namespace anigen::loaders
