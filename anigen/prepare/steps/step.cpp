#include "anigen/prepare/steps/step.h"

#include <system_error>

namespace anigen::prepare {

namespace fs = std::filesystem;

void Step::clear(const AssetPlaces& places) const {
  for (const fs::path& file : outputs(places, options())) {
    std::error_code ignored;
    fs::remove(file, ignored);
  }
}

bool measure_files(const std::vector<fs::path>& files, StepResult& result) {
  result.files = files.size();
  result.bytes = 0;
  for (const fs::path& file : files) {
    std::error_code error;
    const std::uintmax_t size = fs::file_size(file, error);
    if (error) return false;
    result.bytes += size;
  }
  return true;
}

bool up_to_date(const Step& step, const AssetPlaces& places, const StepRecords& records, bool any_options) {
  const auto found = records.steps.find(step.name());
  if (found == records.steps.end()) return false;
  for (const std::string& input : step.inputs()) {
    if (!records.has(input)) return false;
  }
  const Json options = any_options ? found->second.options : step.options();
  if (found->second.fingerprint != records.fingerprint(step.name(), step.version(), options, step.inputs())) {
    return false;
  }
  StepResult now;
  return measure_files(step.outputs(places, options), now) && now.files == found->second.files &&
         now.bytes == found->second.bytes;
}

}  // namespace anigen::prepare
