#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/prepare/steps/asset_job.h"
#include "anigen/prepare/steps/step_record.h"

namespace anigen::prepare {

/// The step that every other one needs: the asset itself, imported or posed.
inline constexpr const char kImport[] = "import";

/// One node of the graph that turns an asset into what training reads. Steps hold options only; everything about an
/// asset comes with the job. Equal jobs and options give equal bytes.
class Step {
 public:
  virtual ~Step() = default;

  virtual std::string name() const = 0;
  /// Raised whenever the same input would give other bytes, so that old outputs are made again.
  virtual int version() const = 0;
  /// Names of the steps whose results this one uses.
  virtual std::vector<std::string> inputs() const { return {kImport}; }
  /// Everything besides its inputs that decides the outputs.
  virtual Json options() const { return Json::object(); }
  /// Files that exist when the step was done under these options of its own.
  virtual std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const = 0;
  /// Removes what an earlier run under other options left and this one may not overwrite.
  virtual void clear(const AssetPlaces& places) const;
  /// Writes the outputs, each by rename. @return the columns @throws InputError for an asset that cannot be used
  virtual Json run(AssetJob& job) const = 0;
};

/// Number and size of files. @return false when one is missing
bool measure_files(const std::vector<std::filesystem::path>& files, StepResult& result);

/// Whether the record says that the step was done by this version on these inputs, and its outputs are there,
/// complete. @param any_options also takes what was made under other options of the step itself
bool up_to_date(const Step& step, const AssetPlaces& places, const StepRecords& records, bool any_options = false);

}  // namespace anigen::prepare
