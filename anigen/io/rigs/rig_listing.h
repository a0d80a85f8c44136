#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::io {

/// Forms of a name, each with the number of its parts: a form of more parts says more about whom it means.
using NameForms = std::map<std::string, int>;

/// All forms in which other programs and lists write a name:
///   - without the extension of a rig or a mesh: "<uuid>.glb" is "<uuid>";
///   - a path also without its leading folders: "glbs/fish/manta.glb" is "fish/manta" and "manta";
///   - a sample of a shard, "in/shard.npz#<uuid>", also "shard.npz#<uuid>" and "<uuid>";
///   - a file that is called by what it is (names_no_asset()), by its folder: "<uuid>/mesh.glb" is "<uuid>".
NameForms name_forms(const std::string& name);
/// The forms of a shape's id and of its other_names().
NameForms name_forms(const ShapeSource& source, const std::string& id);

/// "mesh", "raw_data", "result" and other stems that programs give to the file of every asset.
bool names_no_asset(const std::string& stem);

/// The uuid of "<shard>.npz#<uuid>" (.npz, .pt, .pth); empty for any other name.
std::string key_of_sample(const std::string& name);

/// 64 small hexadecimal digits, as anigen-prepare calls assets.
bool is_sha256(const std::string& text);

/// Finds assets by what split files, predictions and other programs call them. All programs match names by this class.
class NameIndex {
 public:
  void add(const std::string& id, const NameForms& forms);
  void add(const std::string& id, const std::vector<std::string>& names);

  /// The ids that share the form of most parts with these; more than one: the name is ambiguous.
  std::set<std::string> find(const NameForms& forms) const;
  /// @throws InputError(file, place) naming the candidates when there are several @return empty when there is none
  std::string find_one(const std::string& name, const std::string& file, const std::string& place) const;

 private:
  std::map<std::string, std::map<std::string, int>> ids_;  ///< form → id → parts
};

/// Adds the sha256 of these shapes' contents, ShapeSource::sample_id(), where there is one and the file can be read.
void add_content_ids(const ShapeSource& source, const std::vector<std::string>& ids, NameIndex& index);

/// One id of a split file.
struct SplitLine {
  std::string id;
  std::size_t line;  ///< from 1
};

/// The ids of a split file, one a line; blanks around them, empty lines and lines starting with '#' are skipped. May be
/// none: a data set writes an empty list of what it cannot use. @throws InputError when the file is missing
std::vector<SplitLine> split_lines(const std::filesystem::path& file);

/// As above, for a list that somebody asks to be evaluated. @throws InputError also when it names none
std::vector<SplitLine> read_split(const std::filesystem::path& file);

/// The source's ids that the split files name, each once, in the source's order; all of them without split files.
/// A line may be any name of a shape (NameIndex), or the sha256 of its content where sample_id() gives it.
/// @param most only so many of the first ids, as the split files order them; 0: all
/// @throws InputError naming the line for a name that the source does not have, or that several shapes have
std::vector<std::string> select_ids(const ShapeSource& source, const std::vector<std::filesystem::path>& splits,
                                    std::size_t most = 0);

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
bool has_extension(const std::filesystem::path& file, const std::vector<std::string>& extensions);

/// A file and what it refers to: buffers and images of a glTF, the mesh of a text rig, materials and pictures that an
/// .obj, .fbx or .dae names, where they are looked for. Some may not exist; a damaged file refers to nothing.
std::vector<std::filesystem::path> files_read_with(const std::filesystem::path& file);

/// Ids as open_source documents them.
std::vector<FileListSource::Entry> entries_below(const std::filesystem::path& folder,
                                                 const std::vector<std::filesystem::path>& files);

/// @throws InputError when the file is missing, empty, a folder, or a Git LFS pointer, which stands for a file that
/// was not fetched
void require_content(const std::filesystem::path& file);

/// One line of a dataset's metadata.csv, as far as readers of its rigs need it.
struct DatasetItem {
  std::string id;    ///< the sha256 column
  std::string name;  ///< something readable: local_path, else file_identifier, else the id
  /// Id of the row of which this is a posed variant: a shape of its own, which has neither uuid nor other names but its
  /// id. Empty for all others.
  std::string variant_of;
  bool is_variant() const { return !variant_of.empty(); }
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

/// A data set folder as published and as ours are (docs/reference/training.md, 1.1): the rows of metadata.csv with
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
  std::vector<std::string> other_names(const std::string& id) const override { return item(id).other_names; }
  /// The family of "procedural:<family>" in the column `source`.
  std::string category(const std::string& id) const override;

 private:
  const DatasetItem& item(const std::string& id) const;

  std::filesystem::path root_;
  SourceOptions options_;
  std::vector<DatasetItem> items_;
  std::map<std::string, std::size_t> index_;
};

/// Format of the bytes of a rigged asset.
enum class RigFormat { kGltf, kAssimp, kTextRig, kRigArrays, kArticulationXl, kAnymate, kDataset };

const char* name_of(RigFormat format);  ///< "gltf", "assimp", "text_rig", "rig_arrays", "articulation_xl", …
/// @throws InputError for another word
RigFormat parse_rig_format(const std::string& word);

/// One asset on disk: enough to read it again in another process.
struct RigEntry {
  RigFormat format = RigFormat::kGltf;
  std::filesystem::path file;  ///< for kDataset the dataset's folder
  std::string key;             ///< the sample inside the file: uuid, name or id; empty for files with one asset
  /// Below the folder that was listed, with '/'; samples of a shard as "<path>#<key>". For a dataset's asset what its
  /// metadata.csv says, for a posed variant there its id.
  std::string local_path;
  bool is_test = false;      ///< the source says so: is_test of a dataset, a shard called "…test"
  std::string uuid;          ///< what the sample is called in its shard, now or when the dataset was made; or empty
  std::string variant_of{};  ///< id of the dataset's asset of which this is another pose; or empty
};

/// Every rigged asset that a file or folder holds; formats may be mixed, folders of any depth:
///   - .glb, .gltf; .fbx and .dae (Assimp);
///   - text rigs, each with its .obj (text_rig.h); other .txt files are no rigs;
///   - .npz with plain arrays (rig_arrays.h) or with Articulation-XL samples, .pt and .pth with Anymate samples;
///   - a published dataset, told by metadata.csv beside skeleton/: then nothing else in that folder is looked at.
/// Sorted by path, samples in the order of their file. Links to folders are not followed.
/// A damaged shard in a folder is listed as one asset, which then cannot be read.
/// @throws InputError when there is nothing of that, metadata.csv is damaged, or a file named by itself is damaged or
/// none of these
std::vector<RigEntry> list_rigs(const std::filesystem::path& path);

}  // namespace anigen::io
