#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "anigen/io/ndarray.h"
#include "anigen/io/rigs/shape_source.h"

namespace anigen::io {

/// The samples of one `.pt` file of Anymate: a list of dictionaries, a dictionary of them by name, or a single one.
/// Opening reads the list; tensors stay in the file until a sample is read. Not for several threads at once.
/// @throws InputError naming file and place
class AnymateArchive {
 public:
  explicit AnymateArchive(const std::filesystem::path& file);
  ~AnymateArchive();
  AnymateArchive(AnymateArchive&&) noexcept;

  /// Per sample its `name`; else its key; else the file's stem, with "#<number from 0>" when there are several.
  const std::vector<std::string>& names() const { return names_; }
  /// The numbers of a sample by key.
  NamedArrays sample(std::size_t index) const;

 private:
  struct Content;
  std::unique_ptr<Content> content_;
  std::vector<std::string> names_;
};

/// All samples of several such files.
class AnymateSource : public ShapeSource {
 public:
  /// @throws InputError when two samples have the same name
  AnymateSource(const std::vector<std::filesystem::path>& files, const SourceOptions& options, bool single);
  ~AnymateSource() override;

  std::vector<std::string> ids() const override { return ids_; }
  RiggedShape read(const std::string& id) const override;
  std::vector<std::filesystem::path> files(const std::string& id) const override;
  std::string describe() const override;
  std::string sample_id(const std::string& id) const override;
  bool is_single_file() const override { return single_ && ids_.size() == 1; }

 private:
  struct Shard;
  struct Place {
    std::size_t shard, index;
  };
  NamedArrays arrays(const std::string& id, const Shard*& shard) const;

  SourceOptions options_;
  bool single_;
  std::vector<std::unique_ptr<Shard>> shards_;
  std::vector<std::string> ids_;
  std::map<std::string, Place> places_;
};

}  // namespace anigen::io
