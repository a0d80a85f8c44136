#pragma once
#include <filesystem>
#include <map>
#include <string>

#include "anigen/prepare/asset_source.h"

namespace anigen::prepare {

/// aesthetic_score of sources that are assets of another published-layout dataset. Reads each dataset's metadata.csv
/// once.
class SourceScores {
 public:
  /// @return the cell as it stands; empty when there is none, or it is no number
  std::string of(const AssetSource& source);

 private:
  std::map<std::filesystem::path, std::map<std::string, std::string>> by_dataset_;
};

}  // namespace anigen::prepare
