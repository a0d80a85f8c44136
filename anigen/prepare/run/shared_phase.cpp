#include "anigen/prepare/run/shared_phase.h"

#include <map>
#include <mutex>
#include <optional>
#include <utility>

#include "anigen/core/progress.h"
#include "anigen/core/shared_work.h"

namespace anigen::prepare {
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

}  // namespace anigen::prepare
