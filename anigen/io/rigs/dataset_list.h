#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::io {

/// One line of a dataset's metadata.csv, as far as readers of its rigs need it.
struct DatasetItem {
  std::string id;      ///< the sha256 column
  std::string name;    ///< something readable: local_path, else file_identifier, else the id
  std::string source;  ///< "real", "procedural:<family>", or empty
  bool usable = true;  ///< not is_bad_skeleton
  bool bad_skin = false;
  bool test = false;  ///< is_test
};

/// The dataset's items in file order. @throws InputError when metadata.csv is missing, malformed, without `sha256`,
/// or repeats an id
std::vector<DatasetItem> list_dataset(const std::filesystem::path& root);

}  // namespace anigen::io
