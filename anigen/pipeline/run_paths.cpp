#include "anigen/pipeline/run_paths.h"

#include <system_error>

#include "anigen/core/error.h"

namespace anigen::pipeline {

namespace fs = std::filesystem;

fs::path named_run(const fs::path& run, const std::string& name, const fs::path& config, const std::string& pointer) {
  if (name.empty()) throw InputError(config.string(), pointer, "names no run to decode with");
  std::error_code error;
  if (fs::is_directory(name, error)) return name;
  for (fs::path folder = fs::absolute(run).lexically_normal();; folder = folder.parent_path()) {
    if (fs::path(name).is_relative() && fs::is_directory(folder / name, error)) return folder / name;
    if (!folder.has_relative_path()) break;
  }
  throw InputError(config.string(), pointer,
                   "names the run \"" + name + "\", which is neither below the working directory nor beside this run");
}

}  // namespace anigen::pipeline
