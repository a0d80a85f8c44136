#include "anigen/core/run_folder.h"

#include <system_error>

namespace anigen {

namespace fs = std::filesystem;

bool RunFolder::has_config() const {
  std::error_code error;
  return fs::is_regular_file(config(), error);
}

bool RunFolder::has_checkpoints() const {
  std::error_code error;
  return fs::is_directory(checkpoints(), error);
}

std::optional<RunFolder> RunFolder::around(const fs::path& file) {
  const fs::path folder = fs::absolute(file).lexically_normal().parent_path();
  if (RunFolder{folder}.has_config()) return RunFolder{folder};
  const RunFolder above{folder.parent_path()};
  if (folder == above.checkpoints() && above.has_config()) return above;
  return std::nullopt;
}

}  // namespace anigen
