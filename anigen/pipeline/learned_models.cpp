#include "anigen/pipeline/learned_models.h"

#include <system_error>

namespace anigen::pipeline {

namespace fs = std::filesystem;

fs::path run_around(const fs::path& file) {
  std::error_code error;
  const fs::path folder = fs::absolute(file).lexically_normal().parent_path();
  for (const fs::path& run : {folder, folder.filename() == "ckpts" ? folder.parent_path() : folder}) {
    if (fs::is_regular_file(run / "config.json", error)) return run;
  }
  return {};
}

models::RunModel model_at(const fs::path& path, const std::string& class_name) {
  std::error_code error;
  if (fs::is_directory(path, error)) return models::find_run_model(path, class_name);
  const fs::path run = run_around(path);
  if (path.extension() != ".safetensors" || run.empty() || !fs::is_regular_file(path, error)) {
    throw InputError(path.string(), "", "is no run folder and no .safetensors file of one");
  }
  models::RunModel found = models::find_run_model(run, class_name, path.stem().string());
  found.checkpoint = path;
  return found;
}

}  // namespace anigen::pipeline
