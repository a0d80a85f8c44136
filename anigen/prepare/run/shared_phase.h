#pragma once
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/lease.h"
#include "anigen/prepare/run/executor.h"
#include "anigen/prepare/run/pieces.h"

namespace anigen::prepare {

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
std::vector<SourceOutcome> run_phase(const SharedPhase& phase, const LeaseFolder& leases, Executor& executor);

}  // namespace anigen::prepare
