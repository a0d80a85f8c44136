#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>

#include "anigen/prepare/run/run_sources.h"
#include "anigen/prepare/steps/source_outcome.h"

namespace anigen::prepare {

/// Sends tasks somewhere and hands their outcomes in, in any order.
class Executor {
 public:
  /// Asked when there is room for one more. Nothing: it is not for us.
  using Task = std::function<std::optional<SourceTask>(std::size_t)>;
  using Take = std::function<void(std::size_t, SourceOutcome)>;

  virtual ~Executor() = default;
  /// task(i), and take(i, its outcome) where there is a task, for every i in [0, n). Both may be called from several
  /// threads.
  virtual void each(std::size_t n, const Task& task, const Take& take) = 0;
};

/// Worker processes when the options have a command for them, else the threads of this process.
/// @param most how many tasks there will be at most
std::unique_ptr<Executor> make_executor(const std::filesystem::path& out, const StepPlan& plan,
                                        const RunOptions& options, std::size_t most);

}  // namespace anigen::prepare
