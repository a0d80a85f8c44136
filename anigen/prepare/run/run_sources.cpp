#include "anigen/prepare/run/run_sources.h"

#include <algorithm>
#include <memory>
#include <set>
#include <utility>

#include "anigen/prepare/run/executor.h"
#include "anigen/prepare/run/run_lock.h"
#include "anigen/prepare/run/shared_phase.h"

namespace anigen::prepare {
namespace {

/// Finding what a source is takes a moment, and leasing it nearly as long: many go together.
constexpr std::size_t kIdentifiedTogether = 64;
/// More pieces than this are not worth their files; few enough sources a piece, so that nobody waits long for the last.
constexpr std::size_t kPieces = 4096, kMostPreparedTogether = 16;

bool contains(const std::vector<StepFailure>& failures, const StepFailure& wanted) {
  return std::any_of(failures.begin(), failures.end(), [&](const StepFailure& one) {
    return one.id == wanted.id && one.step == wanted.step && one.fingerprint == wanted.fingerprint &&
           one.reason == wanted.reason;
  });
}

/// Finds what each source is, and which repeat an earlier one. @return positions that are left to prepare
std::vector<std::size_t> identify(const SharedPhase& phase, const LeaseFolder& leases, Executor& executor,
                                  std::vector<SourceTask>& tasks, std::vector<SourceOutcome>& outcomes) {
  outcomes = run_phase(phase, leases, executor);
  std::vector<std::size_t> left;
  std::set<std::string> seen;
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    tasks[i].id = outcomes[i].assets.at(0).id;
    if (!tasks[i].id.empty() && seen.insert(tasks[i].id).second) left.push_back(i);
  }
  return left;
}

}  // namespace

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
  std::vector<SourceOutcome> prepared = run_phase(phase, leases, *executor);
  for (std::size_t i = 0; i < left.size(); ++i) outcomes[left[i]] = std::move(prepared[i]);
  return outcomes;
}

}  // namespace anigen::prepare
