#include "anigen/prepare/dataset.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/lease.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/core/run_folder.h"
#include "anigen/prepare/dataset_card.h"
#include "anigen/prepare/manifest.h"

namespace anigen::prepare {

namespace {

namespace fs = std::filesystem;

Json table_settings(const TableOptions& options) {
  Json json = {{"split", options.split.to_json()}, {"near_skeletons", name_of(options.near_skeletons)}};
  json.update(Json(options.limits));
  return json;
}

TableOptions table_options(const Json& json) {
  TableOptions options;
  options.split = SplitOptions::from_json(json.at("split"));
  options.near_skeletons = parse_near_skeletons(json.at("near_skeletons").get<std::string>());
  json.get_to(options.limits);
  return options;
}

/// Workers of one run may each have a GPU of their own; which one it was is nothing about the dataset.
StepPlan lasting(StepPlan plan) {
  plan.features.device.erase(std::min(plan.features.device.find(':'), plan.features.device.size()));
  return plan;
}

Manifest empty_manifest(const PrepareOptions& options, const std::vector<AssetSource>& sources) {
  Manifest manifest;
  manifest.shard = options.run.shard;
  manifest.sources = sources.size();
  Sha256 digest;
  for (const AssetSource& source : sources) digest.update(source.file_identifier + "\n");
  manifest.sources_digest = digest.finish();
  manifest.settings = {{"plan", lasting(options.plan)}, {"tables", table_settings(options.tables)}};
  return manifest;
}

CsvTable rejected_table(const std::vector<Rejected>& rejected) {
  CsvTable table;
  table.columns = {"file_identifier", "reason", "step", "rule"};
  for (const Rejected& one : rejected) table.rows.push_back({one.file_identifier, one.reason, one.step, one.rule});
  return table;
}

/// metadata.csv as it lies there; an empty table when there is none or it cannot be read.
CsvTable earlier_table(const fs::path& file) {
  std::error_code error;
  if (!fs::exists(file, error)) return {};
  try {
    return read_csv(file);
  } catch (const InputError& problem) {
    log::warn("{}; columns that other programs added to it are lost", problem.what());
    return {};
  }
}

/// @throws Error naming what is missing
void require_complete(const fs::path& out, const std::vector<Manifest>& manifests, const StepPlan& plan) {
  constexpr std::size_t kNamed = 5;
  const std::vector<std::string> gaps = find_gaps(out, manifests, plan);
  if (gaps.empty()) return;
  std::string text;
  for (std::size_t i = 0; i < std::min(kNamed, gaps.size()); ++i) text += "; " + gaps[i];
  throw Error(out.string() + ": " + std::to_string(gaps.size()) +
              " assets are not complete, run anigen-prepare again to make what is missing" + text +
              (gaps.size() > kNamed ? "; …" : ""));
}

/// Everything that is made from manifests and records. @pre nobody else writes in the dataset
PrepareSummary write_tables(const fs::path& out, const std::vector<Manifest>& manifests) {
  const auto plan = manifests[0].settings.at("plan").get<StepPlan>();
  const TableOptions options = table_options(manifests[0].settings.at("tables"));
  require_complete(out, manifests, plan);
  DatasetRows found = collect_rows(out, manifests, plan, options.near_skeletons);
  write_file_atomically(out / "rejected.csv", to_csv(rejected_table(found.rejected)));
  std::string failures;
  for (const auto& [source, failure] : found.failures) failures += failure_line(source, failure) + "\n";
  write_file_atomically(out / "failures.jsonl", failures);
  if (found.rows.empty()) {
    throw InputError(
        (out / "rejected.csv").string(), "",
        "none of the " + std::to_string(manifests[0].sources) + " sources could be used; this file says why");
  }
  mark_test(found.rows, options.split, options.limits);
  const SplitCounts splits = write_splits(out, found.rows, options.limits);
  CsvTable table = dataset_table(found.rows, options.limits);
  carry_over_columns(table, earlier_table(out / "metadata.csv"));
  write_file_atomically(out / "metadata.csv", to_csv(table));

  PrepareSummary summary;
  summary.train = splits.train;
  summary.test = splits.test;
  summary.bad_skeleton = splits.unusable;
  summary.rejected_poses = found.rejected_poses;
  summary.failed_steps = found.failures.size();
  for (const DatasetRow& row : found.rows) {
    ++(row.variant > 0 ? summary.variants : row.entry.source.procedural() ? summary.procedural : summary.real);
    summary.bad_skin += bad_skin(row.entry.record, options.limits);
    for (const auto& [name, step] : row.records.steps) summary.bytes += step.bytes;
  }
  write_card(out, found, summary, table, plan);  // last: it draws assets, which may fail
  summary.rejected = std::move(found.rejected);
  return summary;
}

/// Names as JSON and CSV can carry them. A path with other bytes than UTF-8 then leads nowhere, and the source becomes
/// a named failure.
std::vector<AssetSource> representable(const std::vector<AssetSource>& sources) {
  const auto clean = [](const std::string& text) {
    return Json::parse(Json(text).dump(-1, ' ', false, Json::error_handler_t::replace)).get<std::string>();
  };
  std::vector<AssetSource> result = sources;
  for (AssetSource& source : result) {
    source.file = clean(source.file.string());
    source.key = clean(source.key);
    source.local_path = clean(source.local_path);
    source.file_identifier = clean(source.file_identifier);
    source.uuid = clean(source.uuid);
  }
  return result;
}

/// Steps clear the files they make anew, so what they read must lie elsewhere, also when a folder of --output is a
/// link.
void check_sources_lie_outside(const PrepareOptions& options) {
  std::vector<fs::path> written = {fs::weakly_canonical(options.out)};
  std::error_code error;
  for (fs::directory_iterator entry(options.out, error), end; !error && entry != end; entry.increment(error)) {
    std::error_code broken;
    if (entry->is_symlink(broken) && entry->is_directory(broken))
      written.push_back(fs::weakly_canonical(entry->path(), broken));
  }
  for (const AssetSource& source : options.sources) {
    if (source.procedural()) continue;
    const fs::path file = fs::weakly_canonical(source.file);
    for (const fs::path& folder : written) {
      const fs::path below = file.lexically_relative(folder);
      if (!below.empty() && *below.begin() != "..")
        throw InputError(source.file.string(), "",
                         "lies in --output, whose files are written anew: name another folder");
    }
  }
}

void check(const PrepareOptions& options) {
  if (options.sources.empty())
    throw InputError("", "", "nothing to prepare: name input folders or a number of procedural assets");
  options.plan.validate();
  options.tables.split.validate();
  check_sources_lie_outside(options);
}

/// Enters the outcomes of a shard. @return for how many of its sources nothing had to be made
std::size_t enter_outcomes(const std::vector<AssetSource>& sources, const std::vector<SourceOutcome>& outcomes,
                           Manifest& manifest) {
  std::size_t reused = 0;
  SourceScores scores;
  for (const SourceOutcome& outcome : outcomes) {
    ManifestEntry entry;
    entry.number = outcome.number;
    entry.source = sources[outcome.number];
    entry.aesthetic_score = scores.of(entry.source);
    if (!outcome.assets.empty()) entry.id = outcome.assets[0].id;
    bool whole = true;
    for (const AssetOutcome& asset : outcome.assets) {
      whole = whole && asset.reused;  // never set for a repeated content
      entry.failures.insert(entry.failures.end(), asset.failures.begin(), asset.failures.end());
    }
    reused += whole && entry.failures.empty();
    manifest.entries.push_back(std::move(entry));
  }
  return reused;
}

/// Summary of one shard before the merge.
PrepareSummary shard_summary(const Manifest& manifest) {
  PrepareSummary summary;
  summary.merged = false;
  for (const ManifestEntry& entry : manifest.entries) {
    const bool lost = std::any_of(entry.failures.begin(), entry.failures.end(), [](const StepFailure& failure) {
      return failure.variant == 0 && (failure.step == kImport || failure.step == "skeleton");
    });
    summary.failed_steps += entry.failures.size();
    if (lost) {
      const StepFailure& failure = entry.failures[0];
      summary.rejected.push_back({entry.source.file_identifier, failure.reason, failure.step, failure.rule});
    } else {
      ++(entry.source.procedural() ? summary.procedural : summary.real);
    }
  }
  return summary;
}

/// Note of the process that wrote the tables of a run, for the others, run/finished-<i>-of-<n>.json: that they are
/// written, and what is in them. @return nothing when they are not written yet, or the note is damaged: the tables are
/// then written again, with the same bytes
std::optional<PrepareSummary> read_finished(const fs::path& out, const Shard& shard) {
  try {
    return read_json(finished_file(out, shard)).get<PrepareSummary>();
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

/// The end of a run, once everything is done: lists for a merge or, of a whole run, the tables themselves.
PrepareSummary finish(const fs::path& out, const std::vector<AssetSource>& sources,
                      const std::vector<SourceOutcome>& outcomes, Manifest manifest, FailureLog& failures) {
  const Shard shard = manifest.shard;
  const std::size_t reused = enter_outcomes(sources, outcomes, manifest);
  failures.finish(manifest.entries);
  write_manifest(out, manifest);
  // Of processes that were killed meanwhile; those that are left have nothing more to write.
  if (shard.whole()) sweep_temporary_files(out);
  PrepareSummary summary = shard.whole() ? write_tables(out, {manifest}) : shard_summary(manifest);
  summary.reused = reused;
  write_file_atomically(finished_file(out, shard),
                        Json(summary).dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
  return summary;
}

constexpr std::size_t kMostShown = 20;

/// The preparer of a stream.
class Streamer {
 public:
  explicit Streamer(const StreamOptions& options)
      : options_(options), folder_{options.shard.out}, lock_(FileLock::try_lock(folder_.lock(), kAlone)) {
    if (!lock_) throw InputError(folder_.root.string(), "", "another anigen-prepare --stream makes shards there");
    const Json settings = {{"seed", options.seed},
                           {"creatures", options.creatures},
                           {"shards", options.shards},
                           {"plan", lasting(options.shard.plan)},
                           {"tables", table_settings(options.shard.tables)},
                           {"encoders", options.encoders}};
    if (folder_.exists()) {
      index_ = folder_.read_index();
      if (index_.settings != settings)
        throw InputError(folder_.index().string(), "", "the stream has begun with other options: name another folder");
    } else {
      refuse_other_files();
      index_.settings = settings;
      folder_.write_index(index_);
    }
    clear_away_leftovers();
  }

  std::uint64_t run() {
    if (index_.generation == 0) {
      for (std::uint64_t number = 0; number < options_.shards; ++number) make(number);
      StreamIndex first = index_;
      for (std::uint64_t number = 0; number < options_.shards; ++number) first.shards.push_back(number);
      show(first);
    }
    std::uint64_t number = *std::max_element(index_.shards.begin(), index_.shards.end()) + 1;
    for (; options_.end == 0 || number < options_.end; ++number) {
      make(number);
      wait_for_use();
      StreamIndex next = index_;
      next.before = index_.shards;
      next.shards[number % options_.shards] = number;
      show(next);
    }
    return number;
  }

 private:
  static constexpr FileLock::Kind kAlone = FileLock::Kind::kExclusive;

  void refuse_other_files() const {
    for (const auto& entry : fs::directory_iterator(folder_.root)) {
      if (entry.path().filename() != folder_.lock().parent_path().filename())
        throw InputError(folder_.root.string(), "", "holds something that is no stream: name another folder");
    }
  }

  /// Shards that no generation has any more, and what a killed preparer was removing.
  void clear_away_leftovers() const {
    for (const auto& entry : fs::directory_iterator(folder_.root)) {
      if (entry.path().filename().string().rfind(".retired-", 0) == 0) fs::remove_all(entry.path());
    }
    retire();
  }

  void make(std::uint64_t number) const {
    std::error_code error;
    if (fs::exists(folder_.shard(number), error)) return;  // by a call that ended before it was shown
    PrepareOptions options = options_.shard;
    options.out = folder_.making(number);
    options.sources = stream_sources(options_.seed, number, options_.creatures);
    const PrepareSummary summary = prepare_dataset(options);
    if (summary.failed_steps > 0)
      log::warn("shard {}: {} steps failed, see failures.jsonl in it", number, summary.failed_steps);
    for (const std::vector<std::string>& command : options_.commands) call(command, options.out);
    fs::rename(options.out, folder_.shard(number));
    log::info("shard {}: {} creatures", number, summary.train);
  }

  static void call(const std::vector<std::string>& command, const fs::path& shard) {
    ChildProgram program;
    program.words = command;
    program.words.push_back(shard.string());
    ChildProcess child(program);
    std::optional<ChildProcess::End> end;
    while (!(end = child.poll())) {
      if (interrupt_requested()) child.ask_to_stop();
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    throw_if_interrupted();
    if (end->status != 0)
      throw Error(command.front() + " ended with status " + std::to_string(end->status) + " for " + shard.string());
  }

  void show(const StreamIndex& next) {
    index_ = next;
    ++index_.generation;
    folder_.write_index(index_);
    log::info("generation {} of the stream is there", index_.generation);
  }

  void wait_for_use() const {
    for (; folder_.used_generation() < index_.generation; retire()) {
      throw_if_interrupted();
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
    }
    retire();
  }

  std::vector<std::uint64_t> shards_there() const {
    const std::string kind = "shard-";
    std::vector<std::uint64_t> numbers;
    for (const auto& entry : fs::directory_iterator(folder_.root)) {
      const std::string name = entry.path().filename().string();
      if (name.rfind(kind, 0) == 0) numbers.push_back(std::strtoull(name.c_str() + kind.size(), nullptr, 10));
    }
    return numbers;
  }

  /// Removes the shards that only readers of older generations could want, unless one of them holds them.
  void retire() const {
    std::vector<std::uint64_t> wanted = index_.shards;
    if (folder_.used_generation() < index_.generation)
      wanted.insert(wanted.end(), index_.before.begin(), index_.before.end());
    if (wanted.empty()) return;
    const std::uint64_t newest = *std::max_element(wanted.begin(), wanted.end());
    for (const std::uint64_t number : shards_there()) {
      if (number > newest || std::find(wanted.begin(), wanted.end(), number) != wanted.end()) continue;
      const std::optional<FileLock> unread = FileLock::try_lock(folder_.shard_lock(number), kAlone);
      if (!unread) continue;
      fs::rename(folder_.shard(number), folder_.retired(number));
      fs::remove_all(folder_.retired(number));
      fs::remove(folder_.shard_lock(number));
    }
  }

  const StreamOptions& options_;
  const StreamFolder folder_;
  const std::optional<FileLock> lock_;
  StreamIndex index_;
};

}  // namespace

PrepareSummary prepare_dataset(const PrepareOptions& options) {
  check(options);
  const fs::path& out = options.out;
  const Shard& shard = options.run.shard;
  const std::vector<AssetSource> sources = representable(options.sources);
  Manifest manifest = empty_manifest(options, sources);
  const FileLock membership = join_run(out, manifest);
  std::map<std::string, StepCost> costs;
  PrepareSummary summary;
  {
    FailureLog failures(out, shard);
    TimingLog timings(out, shard);
    const std::vector<SourceOutcome> outcomes = run_sources(out, sources, options.plan, options.run, failures, timings);
    costs = timings.costs();
    // Whoever is first writes what is made of all outcomes; for the others it is there.
    const FileLock tables = wait_for_lock(run_folder(out) / "lock-tables", FileLock::Kind::kExclusive);
    if (std::optional<PrepareSummary> finished = read_finished(out, shard)) {
      summary = std::move(*finished);
    } else {
      summary = finish(out, sources, outcomes, std::move(manifest), failures);
    }
  }
  summary.costs = std::move(costs);
  for (const Rejected& one : summary.rejected) log::warn("rejected {}: {}", one.file_identifier, one.reason);
  return summary;
}

PrepareSummary merge_dataset(const fs::path& out) {
  std::error_code error;
  if (!fs::is_directory(out, error)) throw InputError(out.string(), "", "no such folder");
  const FileLock lock = take_alone(out);
  sweep_temporary_files(out);
  return write_tables(out, read_manifests(out));
}

std::uint64_t stream_dataset(const StreamOptions& options) {
  if (options.creatures == 0 || options.shards == 0)
    throw InputError("", "--stream", "needs creatures in every shard, and a shard");
  options.shard.plan.validate();
  return Streamer(options).run();
}

Json to_json(const PrepareSummary& summary) {
  Json json = {{"prepared", summary.prepared()}};
  json.update(Json(summary));
  json["steps"] = to_json(summary.costs);
  return json;
}

std::string to_text(const PrepareSummary& summary) {
  const auto n = [](std::size_t count) { return std::to_string(count); };
  std::string text = "prepared " + n(summary.prepared()) + " assets (" + n(summary.real) + " real, " +
                     n(summary.procedural) + " procedural; " + n(summary.reused) + " were there already)\n";
  if (summary.variants + summary.rejected_poses > 0) {
    text += "and " + n(summary.variants) + " posed variants of them (" + n(summary.rejected_poses) +
            " more had no usable pose)\n";
  }
  if (summary.merged) {
    text += "train " + n(summary.train) + ", test " + n(summary.test) + ", not usable " + n(summary.bad_skeleton) +
            ", bad skin " + n(summary.bad_skin) + "; " + fixed(static_cast<double>(summary.bytes) / 1048576.0, 1) +
            " MiB\n";
  } else {
    text += "one shard of several: `anigen-prepare merge` makes the tables when all have finished\n";
  }
  if (!summary.rejected.empty()) text += "rejected " + n(summary.rejected.size()) + ", see rejected.csv:\n";
  for (std::size_t i = 0; i < summary.rejected.size() && i < kMostShown; ++i)
    text += "  " + summary.rejected[i].file_identifier + ": " + summary.rejected[i].reason + "\n";
  if (summary.rejected.size() > kMostShown) text += "  …\n";
  if (summary.failed_steps > 0) text += n(summary.failed_steps) + " steps failed, see failures.jsonl\n";
  return text + to_text(summary.costs);
}

}  // namespace anigen::prepare
