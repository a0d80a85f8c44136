#include "anigen/prepare/run/run_sources.h"

#include <algorithm>
#include <memory>
#include <mutex>
#include <set>
#include <utility>

#include "anigen/core/progress.h"
#include "anigen/prepare/run/executor.h"

namespace anigen::prepare {
namespace {

bool contains(const std::vector<StepFailure>& failures, const StepFailure& wanted) {
  return std::any_of(failures.begin(), failures.end(), [&](const StepFailure& one) {
    return one.id == wanted.id && one.step == wanted.step && one.fingerprint == wanted.fingerprint &&
           one.reason == wanted.reason;
  });
}

/// Finds what each source is, and which repeat an earlier one. @return positions that are left to prepare
std::vector<std::size_t> identify(Executor& executor, std::vector<SourceTask>& tasks,
                                  std::vector<SourceOutcome>& outcomes) {
  Progress progress("identify", tasks.size(), "assets");
  executor.each(
      tasks.size(),
      [&](std::size_t i) {
        SourceTask task = tasks[i];
        task.only_identify = true;
        return task;
      },
      [&](std::size_t i, SourceOutcome outcome) {
        outcomes[i] = std::move(outcome);
        progress.advance();
      });
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
  std::vector<SourceOutcome> outcomes(tasks.size());
  if (tasks.empty()) return outcomes;
  const std::unique_ptr<Executor> executor = make_executor(out, plan, options, tasks.size());

  const std::vector<std::size_t> left = identify(*executor, tasks, outcomes);
  Progress progress("prepare", left.size(), "assets");
  std::mutex mutex;
  std::size_t failed = 0;
  executor->each(
      left.size(), [&](std::size_t i) { return tasks[left[i]]; },
      [&](std::size_t i, SourceOutcome outcome) {
        const std::lock_guard<std::mutex> lock(mutex);
        const SourceTask& task = tasks[left[i]];
        for (const AssetOutcome& asset : outcome.assets) {
          failed += asset.failures.size();
          for (const StepFailure& failure : asset.failures) {
            if (!contains(task.known, failure)) failures.add(task.source, failure);
          }
        }
        timings.add(outcome);
        outcomes[left[i]] = std::move(outcome);
        if (failed > 0) progress.note(std::to_string(failed) + " failed");
        progress.advance();
      });
  return outcomes;
}

}  // namespace anigen::prepare
