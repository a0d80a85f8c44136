#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/io/rigs/dataset_list.h"
#include "anigen/io/rigs/shape_source.h"

namespace anigen::io {

/// A data set folder as published and as ours are (reference training-and-data.md, 1.1): the rows of metadata.csv with
/// skeleton/<sha256>/skeleton_voxelized.npz; no materials. Rows that the data set marks as bad stay in, with a note.
class DatasetSource : public ShapeSource {
 public:
  /// @throws InputError when metadata.csv is damaged
  explicit DatasetSource(const std::filesystem::path& root, const SourceOptions& options = {});

  std::vector<std::string> ids() const override;
  /// @throws InputError for a sample whose file is missing, a Git LFS pointer, or damaged
  RiggedShape read(const std::string& id) const override;
  std::vector<std::filesystem::path> files(const std::string& id) const override;
  std::string describe() const override;
  bool is_usable(const std::string& id) const override { return item(id).usable; }
  /// uuid, local_path and file_identifier; none for a posed variant.
  std::vector<std::string> other_names(const std::string& id) const override;
  /// The family of "procedural:<family>" in the column `source`.
  std::string category(const std::string& id) const override;

 private:
  const DatasetItem& item(const std::string& id) const;

  std::filesystem::path root_;
  SourceOptions options_;
  std::vector<DatasetItem> items_;
  std::map<std::string, std::size_t> index_;
};

}  // namespace anigen::io
