#pragma once
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/core/json.h"

namespace anigen::prepare {

/// What one step left behind for one asset.
struct StepResult {
  std::string fingerprint;          ///< see StepRecords::fingerprint()
  int version = 1;                  ///< of the step
  Json options = Json::object();    ///< of the step, as far as they decide its outputs
  std::vector<std::string> inputs;  ///< names of the steps whose results it used
  std::size_t files = 0;            ///< outputs
  std::uintmax_t bytes = 0;
  Json columns = Json::object();  ///< what it measured; the merge makes cells of metadata.csv from them
  std::string commit{};  ///< of the program that did it (core/version.h), for people: `version` decides what is kept
};

/// records/<id>.json: which steps are done for an asset, under which options, and what they found. Depends on the
/// asset, the options and the program only: no times, no paths, so that equal runs write equal bytes.
struct StepRecords {
  std::map<std::string, StepResult> steps;  ///< by name

  bool has(const std::string& step) const { return steps.count(step) > 0; }
  /// Digest of everything that decided a step's outputs: its name, version and options, and the fingerprints of its
  /// inputs. @throws Error when an input is not done
  std::string fingerprint(const std::string& step, int version, const Json& options,
                          const std::vector<std::string>& inputs) const;
  /// Forgets every step whose inputs were made anew since, or are gone.
  void drop_stale();
  /// The columns of a step; an empty object when it is not done.
  const Json& columns(const std::string& step) const;
};

/// @return no steps when the file is absent, damaged, or of another version of this program
StepRecords read_step_records(const std::filesystem::path& file);
/// Atomic; steps in alphabetical order, whatever order they ran in.
void write_step_records(const std::filesystem::path& file, const std::string& id, const StepRecords& records);

}  // namespace anigen::prepare
