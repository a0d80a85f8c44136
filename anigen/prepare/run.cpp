#include "anigen/prepare/run.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/lease.h"
#include "anigen/core/log.h"
#include "anigen/prepare/merge.h"
#include "anigen/prepare/workers.h"

namespace anigen::prepare {

namespace {

namespace fs = std::filesystem;

/// "<stem>.tmp-<process>-<n><extension>"
bool is_temporary(const std::string& name) {
  const std::size_t mark = name.rfind(".tmp-");
  if (mark == std::string::npos) return false;
  std::size_t i = mark + 5;
  const auto digits = [&] {
    const std::size_t first = i;
    while (i < name.size() && std::isdigit(static_cast<unsigned char>(name[i]))) ++i;
    return i > first;
  };
  if (!digits() || i >= name.size() || name[i] != '-') return false;
  ++i;
  return digits() && (i == name.size() || name[i] == '.');
}

constexpr const char kJob[] = "job";

/// Identity of a run, shared by all who work on it, with the array job of a cluster where there is one.
Json identity_of(const Manifest& run) {
  const char* job = std::getenv("SLURM_ARRAY_JOB_ID");
  return {{"shards", run.shard.count},
          {"sources", run.sources},
          {"sources_digest", run.sources_digest},
          {"settings", run.settings},
          {kJob, job == nullptr ? "" : job}};
}

/// Of the run that worked here last; null when nobody knows.
Json read_identity(const fs::path& file) {
  try {
    Json json = read_json(file);
    return json.is_object() && json.contains(kJob) ? json : Json();
  } catch (const InputError&) {
    return nullptr;
  }
}

bool same_work(Json one, Json other) {
  if (!one.is_object() || !other.is_object()) return false;
  one.erase(kJob);
  other.erase(kJob);
  return one == other;
}

void require_no_encoder(const fs::path& out) {
  if (!FileLock::try_lock(dataset_lock_file(out), FileLock::Kind::kExclusive))
    throw InputError(out.string(), "", "anigen-encode is working on this dataset; wait until it has finished");
}

void begin_run(const fs::path& out, const Manifest& run) {
  sweep_temporary_files(out);
  remove_lastingly(pieces_folder(out));
  remove_lastingly(leases_folder(out));
  remove_other_manifests(out, run);
  for (std::size_t i = 0; i < run.shard.count; ++i) remove_lastingly(finished_file(out, {i, run.shard.count}));
}

/// At the gate: is this work that we can join, or begin?
void enter(const fs::path& out, const Manifest& run, bool first) {
  require_no_encoder(out);
  const fs::path file = run_folder(out) / "run.json";
  const Json ours = identity_of(run), found = read_identity(file);
  if (!first && !same_work(ours, found)) {
    throw InputError(out.string(), "",
                     "another anigen-prepare is working on this dataset, with other sources or options");
  }
  const bool goes_on = same_work(ours, found) && ours.at(kJob) == found.at(kJob) && ours.at(kJob) != "";
  if (!first || goes_on) return;
  begin_run(out, run);
  write_file_atomically(file, ours.dump(1) + "\n");
}

/// Finding what a source is takes a moment, and leasing it nearly as long: many go together.
constexpr std::size_t kIdentifiedTogether = 64;
/// More pieces than this are not worth their files; few enough sources a piece, so that nobody waits long for the last.
constexpr std::size_t kPieces = 4096, kMostPreparedTogether = 16;

/// One phase of a run, shared with whoever else works on the dataset.
struct SharedPhase {
  std::string label;  ///< of the progress bar
  const Pieces* pieces = nullptr;
  std::function<SourceTask(std::size_t)> task;
  /// An outcome that this process made; called by one thread at a time. @return a note for the bar, or nothing to say
  std::function<std::string(std::size_t, const SourceOutcome&)> made;
};

/// Sends pieces to the executor as their leases can be had, until all are done by somebody.
/// @return what became of every task, in order, from whichever process
/// @throws what Executor::each() throws
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

bool contains(const std::vector<StepFailure>& failures, const StepFailure& wanted) {
  return std::any_of(failures.begin(), failures.end(), [&](const StepFailure& one) {
    return one.id == wanted.id && one.step == wanted.step && one.fingerprint == wanted.fingerprint &&
           one.reason == wanted.reason;
  });
}

/// Finds what each source is, and which repeat an earlier one. @return positions that are left to prepare
std::vector<std::size_t> identify(const SharedPhase& phase, const LeaseFolder& leases, Executor& executor,
                                  std::vector<SourceTask>& tasks, std::vector<SourceOutcome>& outcomes) {
  outcomes = PhaseRun(phase, leases, executor).run();
  std::vector<std::size_t> left;
  std::set<std::string> seen;
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    tasks[i].id = outcomes[i].assets.at(0).id;
    if (!tasks[i].id.empty() && seen.insert(tasks[i].id).second) left.push_back(i);
  }
  return left;
}

}  // namespace

fs::path run_folder(const fs::path& out) { return out / "run"; }

fs::path leases_folder(const fs::path& out) { return run_folder(out) / "leases"; }

fs::path finished_file(const fs::path& out, const Shard& shard) {
  return run_folder(out) / ("finished-" + shard.name() + ".json");
}

FileLock join_run(const fs::path& out, const Manifest& run) {
  std::optional<FileLock> lock =
      join_group(dataset_prepare_lock_file(out), [&](bool first) { enter(out, run, first); });
  if (!lock) throw InputError(out.string(), "", "an anigen-prepare merge is working on this dataset");
  return std::move(*lock);
}

FileLock take_alone(const fs::path& out) {
  std::optional<FileLock> lock = instead_of_group(dataset_prepare_lock_file(out));
  if (!lock) throw InputError(out.string(), "", "another anigen-prepare is working on this dataset");
  require_no_encoder(out);
  return std::move(*lock);
}

std::size_t sweep_temporary_files(const fs::path& out) {
  std::vector<fs::path> stale;
  std::error_code error;
  fs::recursive_directory_iterator entry(out, fs::directory_options::skip_permission_denied, error), end;
  for (; !error && entry != end; entry.increment(error)) {
    std::error_code ignored;
    if (entry->is_regular_file(ignored) && is_temporary(entry->path().filename().string()))
      stale.push_back(entry->path());
  }
  std::size_t removed = 0;
  for (const fs::path& file : stale) {
    std::error_code ignored;
    removed += fs::remove(file, ignored) ? 1 : 0;
  }
  return removed;
}

std::vector<SourceOutcome> run_sources(const std::filesystem::path& out, const std::vector<AssetSource>& sources,
                                       const StepPlan& plan, const RunOptions& options, FailureLog& failures,
                                       TimingLog& timings) {
  const KnownFailures known = options.retry_failed ? KnownFailures{} : FailureLog::read(out);
  std::vector<SourceTask> tasks;
  for (std::size_t i = 0; i < sources.size(); ++i) {
    if (!options.shard.owns(i)) continue;
    tasks.emplace_back();
    tasks.back().number = i;
    tasks.back().source = sources[i];
    const auto found = known.find(sources[i].file_identifier);
    if (found != known.end()) tasks.back().known = found->second;
  }
  std::vector<SourceOutcome> outcomes;
  if (tasks.empty()) return outcomes;
  const std::unique_ptr<Executor> executor = make_executor(out, plan, options, tasks.size());
  const LeaseFolder leases(leases_folder(out));

  const Pieces unknown(out, "identify", options.shard, tasks.size(), kIdentifiedTogether);
  SharedPhase phase;
  phase.label = "identify";
  phase.pieces = &unknown;
  phase.task = [&](std::size_t i) {
    SourceTask task = tasks[i];
    task.only_identify = true;
    return task;
  };
  phase.made = [](std::size_t, const SourceOutcome&) { return std::string(); };
  const std::vector<std::size_t> left = identify(phase, leases, *executor, tasks, outcomes);

  // No two of these have the same content, so that whoever holds a piece is alone with its files.
  const Pieces unprepared(out, "prepare", options.shard, left.size(),
                          std::min(kMostPreparedTogether, left.size() / kPieces + 1));
  std::size_t failed = 0;
  phase.label = "prepare";
  phase.pieces = &unprepared;
  phase.task = [&](std::size_t i) { return tasks[left[i]]; };
  phase.made = [&](std::size_t i, const SourceOutcome& outcome) {
    const SourceTask& task = tasks[left[i]];
    for (const AssetOutcome& asset : outcome.assets) {
      failed += asset.failures.size();
      for (const StepFailure& failure : asset.failures) {
        if (!contains(task.known, failure)) failures.add(task.source, failure);
      }
    }
    timings.add(outcome);
    return failed > 0 ? std::to_string(failed) + " failed" : std::string();
  };
  std::vector<SourceOutcome> prepared = PhaseRun(phase, leases, *executor).run();
  for (std::size_t i = 0; i < left.size(); ++i) outcomes[left[i]] = std::move(prepared[i]);
  return outcomes;
}

}  // namespace anigen::prepare
