#pragma once
#include <filesystem>
#include <map>
#include <string>

#include "anigen/core/files.h"

namespace anigen::test {

/// Contents of every file of a dataset by its path in it, but for run/, which tells about runs and differs between
/// them.
inline std::map<std::string, std::string> dataset_files(const std::filesystem::path& root) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(root)) {
    const std::string path = entry.path().lexically_relative(root).generic_string();
    if (entry.is_regular_file() && path.rfind("run/", 0) != 0) files[path] = read_file(entry.path());
  }
  return files;
}

}  // namespace anigen::test
