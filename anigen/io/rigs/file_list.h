#pragma once
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "anigen/io/rigs/shape_source.h"

namespace anigen::io {

/// Shapes that are a file each.
class FileListSource : public ShapeSource {
 public:
  struct Entry {
    std::string id;
    std::filesystem::path file;
  };
  using Reader = std::function<RiggedShape(const std::filesystem::path& file, const std::string& id)>;

  /// @param reader may be called by several threads at once
  /// @param single whether the user named this one file
  /// @throws InputError when two entries have the same id
  FileListSource(std::vector<Entry> entries, Reader reader, std::string description, bool single);

  std::vector<std::string> ids() const override;
  RiggedShape read(const std::string& id) const override;
  std::vector<std::filesystem::path> files(const std::string& id) const override;
  std::string describe() const override { return description_; }
  /// The file's own name where the id is that of its folder, unless other files are called so too or it says what the
  /// file is and not whom (names_no_asset()).
  std::vector<std::string> other_names(const std::string& id) const override;
  std::string sample_id(const std::string& id) const override;
  bool is_single_file() const override { return single_; }

 private:
  const std::filesystem::path& file(const std::string& id) const;

  std::vector<Entry> entries_;
  std::map<std::string, std::filesystem::path> files_;
  std::map<std::string, std::size_t> stems_;  ///< how many files are called so
  Reader reader_;
  std::string description_;
  bool single_;
};

/// Regular files at any depth whose extension, in lower case and with its dot, is one of these; sorted. Folders that
/// cannot be opened are skipped, links to folders not followed.
std::vector<std::filesystem::path> files_below(const std::filesystem::path& folder,
                                               const std::vector<std::string>& extensions);

/// The extension in lower case, with its dot.
std::string lower_extension(const std::filesystem::path& file);

/// A file and what it refers to: buffers and images of a glTF, the mesh of a text rig, materials and pictures that an
/// .obj, .fbx or .dae names, where they are looked for. Some may not exist; a damaged file refers to nothing.
std::vector<std::filesystem::path> files_read_with(const std::filesystem::path& file);

/// Ids as open_source documents them.
std::vector<FileListSource::Entry> entries_below(const std::filesystem::path& folder,
                                                 const std::vector<std::filesystem::path>& files);

/// @throws InputError when the file is missing, empty, a folder, or a Git LFS pointer, which stands for a file that
/// was not fetched
void require_content(const std::filesystem::path& file);

}  // namespace anigen::io
