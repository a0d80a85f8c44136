#include "anigen/prepare/dataset.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <optional>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/lease.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/prepare/dataset_card.h"
#include "anigen/prepare/manifest.h"
#include "anigen/prepare/merge.h"
#include "anigen/prepare/run.h"

namespace anigen::prepare {

namespace {

namespace fs = std::filesystem;

Manifest empty_manifest(const PrepareOptions& options, const std::vector<AssetSource>& sources) {
  Manifest manifest;
  manifest.shard = options.run.shard;
  manifest.sources = sources.size();
  Sha256 digest;
  for (const AssetSource& source : sources) digest.update(source.file_identifier + "\n");
  manifest.sources_digest = digest.finish();
  // Workers of one run may each have a GPU of their own; which one it was is nothing about the dataset.
  StepPlan plan = options.plan;
  plan.features.device.erase(std::min(plan.features.device.find(':'), plan.features.device.size()));
  manifest.settings = {{"plan", to_json(plan)}, {"tables", to_json(options.tables)}};
  return manifest;
}

void finish_failures(const Manifest& manifest, FailureLog& log) {
  std::vector<std::pair<const AssetSource*, const StepFailure*>> failures;
  for (const ManifestEntry& entry : manifest.entries) {
    for (const StepFailure& failure : entry.failures) failures.emplace_back(&entry.source, &failure);
  }
  log.finish(failures);
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
  const StepPlan plan = step_plan_from_json(manifests[0].settings.at("plan"));
  const TableOptions options = table_options_from_json(manifests[0].settings.at("tables"));
  require_complete(out, manifests, plan);
  DatasetRows found = collect_rows(out, manifests, plan, options.near_skeletons);
  const auto write_rejected = [&] {
    write_file_atomically(out / "rejected.csv", to_csv(rejected_table(found.rejected)));
    std::string failures;
    for (const auto& [source, failure] : found.failures) failures += failure_line(source, failure) + "\n";
    write_file_atomically(out / "failures.jsonl", failures);
  };
  write_rejected();
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
  write_card(out, found, table, plan, options.limits);  // last: it draws assets, which may fail

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

/// Steps clear the files they make anew, so what they read must lie elsewhere, also when a folder of --out is a link.
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
        throw InputError(source.file.string(), "", "lies in --out, whose files are written anew: name another folder");
    }
  }
}

void check(const PrepareOptions& options) {
  if (options.sources.empty()) {
    throw InputError("", "", "nothing to prepare: name input folders or a number of procedural assets");
  }
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

/// The end of a run, once everything is done: lists for a merge or, of a whole run, the tables themselves.
PrepareSummary finish(const fs::path& out, const std::vector<AssetSource>& sources,
                      const std::vector<SourceOutcome>& outcomes, Manifest manifest, FailureLog& failures) {
  const Shard shard = manifest.shard;
  const std::size_t reused = enter_outcomes(sources, outcomes, manifest);
  finish_failures(manifest, failures);
  write_manifest(out, manifest);
  // Of processes that were killed meanwhile; those that are left have nothing more to write.
  if (shard.whole()) sweep_temporary_files(out);
  PrepareSummary summary = shard.whole() ? write_tables(out, {manifest}) : shard_summary(manifest);
  summary.reused = reused;
  write_finished(out, shard, summary);
  return summary;
}

}  // namespace

Json to_json(const TableOptions& options) {
  const QualityLimits& limits = options.limits;
  return {{"split", to_json(options.split)},
          {"near_skeletons", name_of(options.near_skeletons)},
          {"min_joints", limits.min_joints},
          {"max_joints", limits.max_joints},
          {"same_bone", limits.same_bone},
          {"max_outside_share", limits.max_outside_share},
          {"max_invented_rows", limits.max_invented_rows},
          {"least_weight_sum", limits.least_weight_sum}};
}

TableOptions table_options_from_json(const Json& json) {
  TableOptions options;
  options.split = split_options_from_json(json.at("split"));
  options.near_skeletons = parse_near_skeletons(json.at("near_skeletons").get<std::string>());
  json.at("min_joints").get_to(options.limits.min_joints);
  json.at("max_joints").get_to(options.limits.max_joints);
  json.at("same_bone").get_to(options.limits.same_bone);
  json.at("max_outside_share").get_to(options.limits.max_outside_share);
  json.at("max_invented_rows").get_to(options.limits.max_invented_rows);
  json.at("least_weight_sum").get_to(options.limits.least_weight_sum);
  return options;
}

PrepareSummary prepare_dataset(const PrepareOptions& options) {
  check(options);
  const fs::path& out = options.out;
  const Shard& shard = options.run.shard;
  const std::vector<AssetSource> sources = representable(options.sources);
  Manifest manifest = empty_manifest(options, sources);
  const RunMembership membership(out, manifest);
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
  const RunAlone lock(out);
  sweep_temporary_files(out);
  return write_tables(out, read_manifests(out));
}

namespace {

class PhaseRun {
 public:
  PhaseRun(const SharedPhase& phase, const LeaseFolder& leases, Executor& executor)
      : phase_(phase),
        pieces_(*phase.pieces),
        leases_(leases),
        executor_(executor),
        outcomes_(pieces_.size()),
        progress_(phase.label, pieces_.size() == 0 ? 0 : pieces_.range(pieces_.size() - 1).second, "assets") {}

  std::vector<SourceOutcome> run() {
    std::vector<std::string> names;
    for (std::size_t piece = 0; piece < pieces_.size(); ++piece) names.push_back(pieces_.name(piece));
    work_together(
        leases_, names, [this](std::size_t piece) { return done(piece); },
        [this](const std::vector<std::size_t>& pieces, const Claim& claim) { pass(pieces, claim); });
    std::vector<SourceOutcome> all;
    for (auto& outcomes : outcomes_) {
      for (SourceOutcome& outcome : *outcomes) all.push_back(std::move(outcome));
    }
    return all;
  }

 private:
  /// A piece that was asked for in this pass.
  struct Open {
    std::optional<Lease> lease;  ///< nothing: somebody else has it
    std::vector<SourceOutcome> outcomes;
    std::size_t missing = 0;
  };

  /// Not for two threads at a time: a pass asks under its mutex.
  bool done(std::size_t piece) {
    if (outcomes_[piece]) return true;
    outcomes_[piece] = pieces_.read(piece);
    if (!outcomes_[piece]) return false;
    progress_.advance(outcomes_[piece]->size());
    return true;
  }

  void pass(const std::vector<std::size_t>& pieces, const Claim& claim) {
    std::vector<std::size_t> tasks;
    for (const std::size_t piece : pieces) {
      const auto [begin, end] = pieces_.range(piece);
      for (std::size_t task = begin; task < end; ++task) tasks.push_back(task);
    }
    std::mutex mutex;
    std::map<std::size_t, Open> open;
    executor_.each(
        tasks.size(),
        [&](std::size_t i) -> std::optional<SourceTask> {
          const std::lock_guard<std::mutex> lock(mutex);
          const std::size_t piece = pieces_.of_task(tasks[i]);
          const auto [entry, is_new] = open.try_emplace(piece);
          if (is_new) {
            const auto [begin, end] = pieces_.range(piece);
            entry->second.lease = claim(piece);
            entry->second.missing = end - begin;
            entry->second.outcomes.resize(end - begin);
          }
          if (!entry->second.lease) return std::nullopt;
          return phase_.task(tasks[i]);
        },
        [&](std::size_t i, SourceOutcome outcome) {
          const std::lock_guard<std::mutex> lock(mutex);
          const std::size_t piece = pieces_.of_task(tasks[i]);
          Open& mine = open.at(piece);
          const std::string note = phase_.made(tasks[i], outcome);
          if (!note.empty()) progress_.note(note);
          mine.outcomes[tasks[i] - pieces_.range(piece).first] = std::move(outcome);
          progress_.advance();
          if (--mine.missing > 0) return;
          pieces_.write(piece, mine.outcomes);
          outcomes_[piece] = std::move(mine.outcomes);
          mine.lease.reset();  // after the file: who takes the lease next finds the piece done
        });
  }

  const SharedPhase& phase_;
  const Pieces& pieces_;
  const LeaseFolder& leases_;
  Executor& executor_;
  std::vector<std::optional<std::vector<SourceOutcome>>> outcomes_;
  Progress progress_;
};

}  // namespace

std::vector<SourceOutcome> run_phase(const SharedPhase& phase, const LeaseFolder& leases, Executor& executor) {
  return PhaseRun(phase, leases, executor).run();
}

namespace {

PrepareSummary summary_from_json(const Json& json) {
  PrepareSummary summary;
  json.at("real").get_to(summary.real);
  json.at("procedural").get_to(summary.procedural);
  json.at("variants").get_to(summary.variants);
  json.at("rejected_poses").get_to(summary.rejected_poses);
  json.at("reused").get_to(summary.reused);
  json.at("bad_skeleton").get_to(summary.bad_skeleton);
  json.at("bad_skin").get_to(summary.bad_skin);
  json.at("train").get_to(summary.train);
  json.at("test").get_to(summary.test);
  json.at("failed_steps").get_to(summary.failed_steps);
  json.at("bytes").get_to(summary.bytes);
  json.at("merged").get_to(summary.merged);
  for (const Json& one : json.at("rejected")) {
    summary.rejected.push_back({one.at("file_identifier").get<std::string>(), one.at("reason").get<std::string>(),
                                one.at("step").get<std::string>(), one.at("rule").get<std::string>()});
  }
  return summary;
}

}  // namespace

std::optional<PrepareSummary> read_finished(const std::filesystem::path& out, const Shard& shard) {
  const std::filesystem::path file = finished_file(out, shard);
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return std::nullopt;
  try {
    return summary_from_json(read_json(file));
  } catch (const InputError&) {
    return std::nullopt;  // damaged: the tables are written again, with the same bytes
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

void write_finished(const std::filesystem::path& out, const Shard& shard, const PrepareSummary& summary) {
  write_file_atomically(finished_file(out, shard),
                        to_json(summary).dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace anigen::prepare
