#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::io {

/// One line of a dataset's metadata.csv, as far as readers of its rigs need it.
struct DatasetItem {
  std::string id;    ///< the sha256 column
  std::string name;  ///< something readable: local_path, else file_identifier, else the id
  /// A posed variant of another row: a shape of its own, which has neither uuid nor other names but its id.
  bool is_variant = false;
  std::vector<std::string> other_names;  ///< what else the asset is called: its uuid, local_path and file_identifier
  std::string uuid;    ///< of the sample in the shard it came from; in older tables read from "<shard>#<uuid>"
  std::string source;  ///< "real", "procedural:<family>", or empty
  bool usable = true;  ///< not is_bad_skeleton
  bool bad_skin = false;
  bool test = false;  ///< is_test
};

/// The dataset's items in file order. @throws InputError when metadata.csv is missing, malformed, without `sha256`,
/// or repeats an id
std::vector<DatasetItem> list_dataset(const std::filesystem::path& root);

}  // namespace anigen::io
