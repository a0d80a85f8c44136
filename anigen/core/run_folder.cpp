#include "anigen/core/run_folder.h"

#include <cstdio>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/files.h"

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

std::string StreamFolder::named(const char* kind, std::uint64_t number) {
  char text[48];
  std::snprintf(text, sizeof text, "%s%06llu", kind, static_cast<unsigned long long>(number));
  return text;
}

bool StreamFolder::exists() const {
  std::error_code error;
  return fs::is_regular_file(index(), error);
}

StreamIndex StreamFolder::read_index() const {
  try {
    return read_json(index()).get<StreamIndex>();
  } catch (const Json::exception& problem) {
    throw InputError(index().string(), "", std::string("is damaged: ") + problem.what());
  }
}

void StreamFolder::write_index(const StreamIndex& index) const {
  write_file_atomically(this->index(), Json(index).dump(1) + "\n");
}

std::uint64_t StreamFolder::used_generation() const {
  std::error_code error;
  const fs::path file = root / "used.json";
  return fs::exists(file, error) ? read_json(file).value("generation", std::uint64_t{0}) : 0;
}

void StreamFolder::mark_used(std::uint64_t generation) const {
  if (generation <= used_generation()) return;
  write_file_atomically(root / "used.json", Json{{"generation", generation}}.dump() + "\n");
}

}  // namespace anigen
