#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>

#include "anigen/prepare/run/run_sources.h"
#include "anigen/prepare/steps/source_outcome.h"

namespace anigen::prepare {

/// Sends tasks somewhere and hands their outcomes in, in any order.
class Executor {
 public:
  using Task = std::function<SourceTask(std::size_t)>;
  using Take = std::function<void(std::size_t, SourceOutcome)>;

  virtual ~Executor() = default;
  /// task(i) and take(i, its outcome) for every i in [0, n). take() may be called from several threads.
  virtual void each(std::size_t n, const Task& task, const Take& take) = 0;
};

/// Worker processes when the options have a command for them, else the threads of this process.
/// @param most how many tasks there will be at most
std::unique_ptr<Executor> make_executor(const std::filesystem::path& out, const StepPlan& plan,
                                        const RunOptions& options, std::size_t most);

}  // namespace anigen::prepare
