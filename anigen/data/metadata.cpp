#include "anigen/data/metadata.h"

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <sstream>
#include <system_error>

#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/random.h"
#include "anigen/io/rigs/rig_listing.h"

namespace anigen::data {

namespace {

namespace fs = std::filesystem;

double number(const CsvTable& table, std::size_t row, const std::string& column, const std::string& file) {
  const std::string& text = table.cell(row, column);
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || end != text.c_str() + text.size())
    throw InputError(file, "row " + std::to_string(row + 1) + ", " + column, "'" + text + "' is not a number");
  return value;
}

std::uint64_t voxel_count(const CsvTable& table, std::size_t row, const std::string& file) {
  if (table.cell(row, "num_voxels").empty()) return 0;
  const double count = number(table, row, "num_voxels", file);
  if (!(count >= 0.0) || count > 1e15)
    throw InputError(file, "row " + std::to_string(row + 1) + ", num_voxels", "is not a number of voxels");
  return static_cast<std::uint64_t>(count);
}

// Filters one after another, so that the one that leaves nothing can be named.
class Sieve {
 public:
  Sieve(const CsvTable& table, std::string file) : file_(std::move(file)) {
    for (std::size_t i = 0; i < table.rows.size(); ++i) rows_.push_back(i);
    if (rows_.empty()) throw InputError(file_, "", "has no rows");
  }

  void keep(const std::string& filter, const std::function<bool(std::size_t)>& passes) {
    std::vector<std::size_t> kept;
    for (const std::size_t row : rows_) {
      if (passes(row)) kept.push_back(row);
    }
    if (kept.empty()) {
      throw InputError(
          file_, filter,
          "this filter leaves none of the " + std::to_string(rows_.size()) + " rows that passed the filters before it");
    }
    rows_ = std::move(kept);
  }

  const std::vector<std::size_t>& rows() const { return rows_; }

 private:
  std::string file_;
  std::vector<std::size_t> rows_;
};

// An id names a folder below the root; nothing else may come out of a table.
bool safe_id(const std::string& id) {
  return !id.empty() && id.size() <= 200 && id.front() != '.' && id.find('/') == std::string::npos &&
         id.find('\\') == std::string::npos && id.find('\0') == std::string::npos;
}

std::vector<fs::path> roots_of(const std::string& data_dir) {
  std::vector<fs::path> roots;
  std::istringstream words(data_dir);
  for (std::string root; std::getline(words, root, ',');) {
    if (!root.empty()) roots.emplace_back(root);
  }
  return roots;
}

std::string comma_joined(const std::vector<fs::path>& roots) {
  std::string text;
  for (const fs::path& root : roots) text += (text.empty() ? "" : ",") + root.string();
  return text;
}

// "procedural/<seed>/<index>"; "" for the name of a file.
std::string creature_of(const CsvTable& table, std::size_t row) {
  const std::string prefix = "procedural/";
  const std::string& text = table.cell(row, "file_identifier");
  const bool numbers = text.find_first_not_of("0123456789/", std::min(prefix.size(), text.size())) == std::string::npos;
  return text.rfind(prefix, 0) == 0 && numbers ? text : "";
}

std::uint64_t seed_of(const std::string& creature) {
  return std::strtoull(creature.c_str() + std::string("procedural/").size(), nullptr, 10);
}

double share_of(const std::string& id) { return static_cast<double>(stable_hash(id) >> 11) * 0x1.0p-53; }

}  // namespace

std::set<std::string> read_split(const fs::path& file) {
  std::istringstream lines(read_file(file, std::uintmax_t{1} << 28));
  std::set<std::string> ids;
  for (std::string line; std::getline(lines, line);) {
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
    if (!line.empty() && line.front() != '#') ids.insert(line);
  }
  if (ids.empty()) throw InputError(file.string(), "", "holds no ids");
  return ids;
}

std::set<std::string> read_split(const fs::path& file, const std::string& data_dir) {
  const std::set<std::string> names = read_split(file);
  const std::vector<fs::path> roots = roots_of(data_dir);
  std::set<std::string> known, ids;
  for (const fs::path& root : roots) {
    const CsvTable table = read_csv(root / "metadata.csv");
    for (std::size_t row = 0; row < table.rows.size(); ++row) known.insert(table.cell(row, "sha256"));
  }
  if (std::includes(known.begin(), known.end(), names.begin(), names.end())) return names;
  io::NameIndex index;
  for (const fs::path& root : roots) {
    for (const io::DatasetItem& item : io::list_dataset(root)) index.add(item.id, item.other_names);
  }
  for (const std::string& name : names) {
    const std::string id = known.count(name) > 0 ? name : index.find_one(name, file.string(), "\"" + name + "\"");
    ids.insert(id.empty() ? name : id);
  }
  return ids;
}

std::vector<AssetId> select_rows(const CsvTable& table, const fs::path& root, const RowFilter& filter) {
  const std::string file = (root / "metadata.csv").string();
  const auto has = [&](const std::string& name) { return table.column(name) != CsvTable::kMissing; };
  const auto require = [&](const std::string& name) {
    if (!has(name)) throw InputError(file, name, "no such column; prepare the dataset up to this step first");
  };
  if (!has("sha256")) throw InputError(file, "sha256", "no such column; it holds the ids");
  Sieve sieve(table, file);
  if (filter.only) {
    sieve.keep("split", [&](std::size_t row) { return filter.only->count(table.cell(row, "sha256")) > 0; });
  }
  if (filter.instances) {
    sieve.keep("instances", [&](std::size_t row) { return filter.instances->count(table.cell(row, "sha256")) > 0; });
  }
  for (const std::string& column : filter.required_columns) require(column);
  for (const std::string& flag : filter.required_flags) {
    require(flag);
    sieve.keep(flag, [&](std::size_t row) { return table.flag(row, flag, false, file); });
  }
  if (has("aesthetic_score")) {
    const std::string name = "min_aesthetic_score " + std::to_string(filter.min_aesthetic_score);
    sieve.keep(name, [&](std::size_t row) {
      return number(table, row, "aesthetic_score", file) >= filter.min_aesthetic_score;
    });
  }
  if (filter.max_num_voxels && has("num_voxels")) {
    const auto limit = static_cast<double>(*filter.max_num_voxels);
    sieve.keep("max_num_voxels " + std::to_string(*filter.max_num_voxels),
               [&](std::size_t row) { return number(table, row, "num_voxels", file) <= limit; });
  }
  if (filter.drop_bad_skeleton) {
    sieve.keep("is_bad_skeleton", [&](std::size_t row) { return !table.flag(row, "is_bad_skeleton", false, file); });
  }
  if (filter.drop_bad_skin) {
    sieve.keep("filter_bad_skin", [&](std::size_t row) { return !table.flag(row, "is_bad_skin", false, file); });
  }
  if (filter.is_test) {
    if (!has("is_test")) throw InputError(file, "is_test", "no such column, which \"test_mode\": true needs");
    sieve.keep(*filter.is_test ? "is_test true" : "is_test false",
               [&](std::size_t row) { return table.flag(row, "is_test", false, file) == *filter.is_test; });
  }
  std::vector<AssetId> assets;
  std::set<std::string> seen;
  for (const std::size_t row : sieve.rows()) {
    const std::string& id = table.cell(row, "sha256");
    const std::string place = "row " + std::to_string(row + 1) + ", sha256";
    if (!safe_id(id)) throw InputError(file, place, "'" + id.substr(0, 80) + "' cannot be the name of a folder");
    if (!seen.insert(id).second) throw InputError(file, place, "'" + id + "' is there twice");
    std::size_t repeat = 1;
    if (!filter.repeat.empty() && has("source")) {
      const auto found = filter.repeat.find(table.cell(row, "source"));
      if (found != filter.repeat.end()) repeat = found->second;
    }
    assets.push_back({root, id, repeat, voxel_count(table, row, file), table.flag(row, "is_bad_skin", false, file),
                      has("file_identifier") ? creature_of(table, row) : "",
                      has("source") ? table.cell(row, "source") : "",
                      has("variant_of") ? table.cell(row, "variant_of") : ""});
  }
  return assets;
}

std::vector<AssetId> select_assets(const std::string& data_dir, const RowFilter& filter) {
  std::vector<AssetId> assets;
  for (const fs::path& root : roots_of(data_dir)) {
    if (StreamFolder{root}.exists())
      throw NotSupportedError(root.string(), "", "a stream of shards here; one of its shards can be taken");
    const std::vector<AssetId> more = select_rows(read_csv(root / "metadata.csv"), root, filter);
    assets.insert(assets.end(), more.begin(), more.end());
  }
  if (assets.empty()) throw InputError("--dataset", "", "names no dataset root");
  return assets;
}

fs::path file_of_dataset(const std::string& name, const std::string& data_dir) {
  std::vector<fs::path> roots = roots_of(data_dir);
  while (roots.size() > 1 && StreamFolder{roots.front()}.exists()) roots.erase(roots.begin());
  const fs::path below_root = (roots.empty() ? fs::path() : roots.front()) / name;
  std::error_code error;
  return fs::exists(below_root, error) ? below_root : fs::path(name);
}

std::optional<StreamFolder> stream_of(const std::string& data_dir) {
  std::optional<StreamFolder> found;
  for (const fs::path& root : roots_of(data_dir)) {
    if (!StreamFolder{root}.exists()) continue;
    if (found) throw NotSupportedError(root.string(), "", "a second stream of shards in one training");
    found = StreamFolder{root};
  }
  return found;
}

std::shared_ptr<const StreamGeneration> newest_generation(const StreamFolder& folder) {
  constexpr int kTries = 100;  // a shard may fall out and go between the reading of the index and the lock
  for (int i = 0; i < kTries; ++i) {
    const StreamIndex index = folder.read_index();
    if (index.generation == 0) {
      throw InputError(folder.root.string(), "",
                       "is a stream whose first shards are not made yet: wait for anigen-prepare --stream");
    }
    if (auto held = hold_generation(folder, index.generation, index.shards)) return held;
  }
  throw InputError(folder.root.string(), "", "is a stream of which shards are missing");
}

std::shared_ptr<const StreamGeneration> hold_generation(const StreamFolder& folder, std::uint64_t number,
                                                        const std::vector<std::uint64_t>& shards) {
  auto held = std::make_shared<StreamGeneration>();
  held->number = number;
  held->shards = shards;
  for (const std::uint64_t shard : shards) {
    std::optional<FileLock> lock = FileLock::try_lock(folder.shard_lock(shard), FileLock::Kind::kShared);
    std::error_code error;
    if (!lock || !fs::exists(folder.shard(shard) / "metadata.csv", error)) return nullptr;
    held->locks.push_back(std::move(*lock));
  }
  return held;
}

void RowFilter::read_rigged(ConfigReader& reader) {
  max_num_voxels = reader.integer("max_num_voxels", 32768, 0);
  drop_bad_skin = reader.boolean("filter_bad_skin", false);
  const bool test_mode = reader.boolean("test_mode", true), is_test_row = reader.boolean("is_test", false);
  if (test_mode) is_test = is_test_row;
}

void SourceOptions::read_common(ConfigReader& reader) {
  ConfigFields f(reader);
  f("data_dir", data_dir);
  f("split", split);
  f("eval_split", eval_split);
  f("eval_fraction", eval_fraction, {0.0, 0.9});
  f("train_share", train_share, {0.0, 1.0});
  f("skip_broken", skip_broken);
  f("test_splits", test_splits);
  f("min_aesthetic_score", filter.min_aesthetic_score);
  std::optional<std::vector<std::string>> ids;
  f("instances", ids);
  if (ids) filter.instances.emplace(ids->begin(), ids->end());
  ConfigReader repeat = reader.object("repeat_sources");
  if (const Json* sources = reader.raw("repeat_sources"); sources != nullptr && sources->is_object()) {
    for (const auto& source : sources->items())
      filter.repeat[source.key()] = static_cast<std::size_t>(repeat.integer(source.key(), 1, 1, 10000));
  }
  repeat.finish();
}

namespace {

struct StreamRoots {
  std::vector<fs::path> shards, fixed;
};

StreamRoots roots_of_generation(const std::string& data_dir, const StreamFolder& stream,
                                const StreamGeneration& generation) {
  StreamRoots roots;
  for (const std::uint64_t shard : generation.shards) roots.shards.push_back(stream.shard(shard));
  for (const fs::path& root : roots_of(data_dir)) {
    if (root != stream.root) roots.fixed.push_back(root);
  }
  return roots;
}

// A dataset of test assets alone has an empty train.txt.
bool names_something(const fs::path& split) {
  std::error_code error;
  return fs::exists(split, error) && fs::file_size(split, error) > 0;
}

std::set<std::string> names_in_shards(const std::vector<fs::path>& shards, const std::string& split) {
  std::set<std::string> all;
  for (const fs::path& shard : shards) {
    if (names_something(shard / split)) all.merge(read_split(shard / split, shard.string()));
  }
  return all;
}

}  // namespace

TrainAndEval select(const SourceOptions& options, const StreamGeneration* generation) {
  const std::optional<StreamFolder> stream = stream_of(options.data_dir);
  if (stream && generation == nullptr)
    throw NotSupportedError(stream->root.string(), "", "a stream of shards here; one of its shards can be taken");
  RowFilter filter = options.filter;
  TrainAndEval result;
  result.roots = options.data_dir;
  std::string fixed = options.data_dir, shards;  // roots whose assets stay, and those of a stream
  std::set<std::string> of_shards;               // what their split files name
  if (stream) {
    if (options.eval_fraction > 0.0)
      throw NotSupportedError(options.data_dir, "eval_fraction", "an eval_fraction of a stream of shards");
    const StreamRoots roots = roots_of_generation(options.data_dir, *stream, *generation);
    fixed = comma_joined(roots.fixed);
    shards = comma_joined(roots.shards);
    result.roots = fixed.empty() ? shards : shards + "," + fixed;
    if (!options.split.empty()) of_shards = names_in_shards(roots.shards, options.split);
  }
  std::set<std::string> held_out;
  if (!options.eval_split.empty()) {
    if (fixed.empty()) {
      throw InputError(options.data_dir, "eval_split",
                       "a stream holds out nothing: name a dataset with such assets after it, STREAM,DATASET");
    }
    held_out = read_split(file_of_dataset(options.eval_split, fixed), fixed);
    RowFilter evaluated = filter;
    evaluated.only = held_out;
    evaluated.repeat.clear();
    result.eval = select_assets(fixed, evaluated);
  }
  std::string trained = result.roots;
  if (!options.split.empty()) {
    const fs::path file = file_of_dataset(options.split, fixed);
    if (!stream || names_something(file)) {
      of_shards.merge(read_split(file, fixed.empty() ? result.roots : fixed));
    } else {
      trained = shards;
    }
    filter.only = std::move(of_shards);
  }
  for (const AssetId& asset : select_assets(trained, filter)) {
    // An asset and its posed variants have one mesh and rig: they stay together.
    const std::string& original = asset.variant_of.empty() ? asset.id : asset.variant_of;
    if (held_out.count(asset.id) > 0 || held_out.count(original) > 0) continue;
    const bool chosen = options.eval_split.empty() && share_of(original) < options.eval_fraction;
    // Another hash than that of eval_fraction, so that the two do not choose alike.
    if (!chosen && options.train_share < 1.0 && share_of("share " + original) >= options.train_share) continue;
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

void refuse_test_creatures(const TrainAndEval& assets, const SourceOptions& options) {
  std::map<std::string, std::string> kept;  // creature or id → where that is said
  for (const std::string& split : options.test_splits) {
    const fs::path file = file_of_dataset(split, options.data_dir);
    for (const std::string& name : read_split(file)) kept[name] = file.string();
  }
  // Of assets that are called otherwise there, such as by a uuid, the ids.
  for (const fs::path& root : options.test_splits.empty() ? std::vector<fs::path>() : roots_of(assets.roots)) {
    for (const io::DatasetItem& item : io::list_dataset(root)) {
      for (const std::string& name : item.other_names) {
        if (const auto named = kept.find(name); named != kept.end()) kept[item.id] = std::string(named->second);
      }
    }
  }
  for (const fs::path& root : roots_of(assets.roots)) {
    const std::string file = (root / "metadata.csv").string();
    const CsvTable table = read_csv(file);
    const bool told = table.column("is_test") != CsvTable::kMissing;
    if (table.column("file_identifier") == CsvTable::kMissing) continue;
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
      const std::string creature = creature_of(table, row);
      const auto named = kept.find(table.cell(row, "sha256"));
      if (creature.empty()) continue;
      if (named != kept.end()) kept[creature] = named->second;
      if (told && table.flag(row, "is_test", false, file)) kept[creature] = "is_test of " + file;
    }
  }
  for (const AssetId& asset : assets.train) {
    const std::string& creature = asset.creature;
    std::string reason;
    if (!creature.empty() && creature_seeds::is_test(seed_of(creature))) reason = "all creatures of this seed are";
    for (const std::string& name : {creature, asset.id, asset.variant_of}) {
      const auto found = kept.find(name);
      if (reason.empty() && found != kept.end() && !name.empty()) reason = found->second + " says so";
    }
    if (reason.empty()) continue;
    throw InputError(
        asset.root.string(), asset.id,
        (creature.empty() ? "" : "creature " + creature + ", seed " + std::to_string(seed_of(creature)) + ", ") +
            "is kept for testing and may not be trained on (" + reason +
            "); \"split\": \"splits/train.txt\" takes the others");
  }
}

void report_broken(const std::vector<std::string>& problems, std::size_t assets, bool skip_broken) {
  constexpr std::size_t kNamed = 5;
  if (!problems.empty() && !skip_broken) {
    std::string named;
    for (std::size_t i = 0; i < std::min(kNamed, problems.size()); ++i) named += "\n  " + problems[i];
    throw InputError("", "dataset",
                     std::to_string(problems.size()) + " of " + std::to_string(assets) +
                         " assets cannot be read; \"skip_broken\": true leaves them out:" + named);
  }
  for (const std::string& problem : problems) log::warn("left out: {}", problem);
  if (problems.size() >= assets)
    throw InputError("", "dataset", "none of the " + std::to_string(assets) + " assets can be read");
}

void BrokenAssets::note(const std::string& id, const std::string& problem) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!problems_.emplace(id, problem).second) return;
  log::warn("{} broken assets so far; another one takes the place of {}: {}", problems_.size(), id, problem);
}

std::map<std::string, std::string> BrokenAssets::problems() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return problems_;
}

}  // namespace anigen::data
