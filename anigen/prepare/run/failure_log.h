#pragma once
#include <cstdio>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/prepare/run/shard.h"
#include "anigen/prepare/steps/source_outcome.h"

namespace anigen::prepare {

/// Failures by the source's file_identifier.
using KnownFailures = std::map<std::string, std::vector<StepFailure>>;

/// run/failures-<i>-of-<n>.jsonl: one line per failure with source, id, variant, step, reason. While the run goes on
/// every process appends to a file of its own, failures-<i>-of-<n>-<process>.jsonl, so that what a killed run found out
/// is not found out again; finish() puts one file in their place.
class FailureLog {
 public:
  /// Opens this process' file. @throws Error when it cannot be written
  FailureLog(const std::filesystem::path& out, const Shard& shard);
  ~FailureLog();
  FailureLog(const FailureLog&) = delete;
  FailureLog& operator=(const FailureLog&) = delete;

  void add(const AssetSource& source, const StepFailure& failure);
  /// Replaces the files of all processes by one with these failures. @param failures with their sources, in order
  void finish(const std::vector<std::pair<const AssetSource*, const StepFailure*>>& failures);

  /// What all shards failed at so far; a line that a kill cut off is left out.
  static KnownFailures read(const std::filesystem::path& out);

 private:
  std::filesystem::path out_;
  std::string name_;
  std::filesystem::path file_;
  std::FILE* stream_ = nullptr;
  std::size_t count_ = 0;
};

/// The line, without its end.
std::string failure_line(const AssetSource& source, const StepFailure& failure);

}  // namespace anigen::prepare
