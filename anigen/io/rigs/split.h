#pragma once
#include <cstddef>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "anigen/io/rigs/shape_source.h"

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

/// "a, b, c and 4 more".
std::string listed(const std::set<std::string>& names, std::size_t most = 3);

/// One id of a split file.
struct SplitLine {
  std::string id;
  std::size_t line;  ///< from 1
};

/// The ids of a split file, one a line; blanks around them, empty lines and lines starting with '#' are skipped. May be
/// none: a data set writes an empty list of what it cannot use. @throws InputError when the file is missing
std::vector<SplitLine> split_lines(const std::filesystem::path& file);

/// The same for a list that somebody asks to be evaluated. @throws InputError also when it names none
std::vector<SplitLine> read_split(const std::filesystem::path& file);

/// The source's ids that the split files name, each once, in the source's order; all of them without split files.
/// A line may be any name of a shape (NameIndex), or the sha256 of its content where sample_id() gives it.
/// @param most only so many of the first ids, as the split files order them; 0: all
/// @throws InputError naming the line for a name that the source does not have, or that several shapes have
std::vector<std::string> select_ids(const ShapeSource& source, const std::vector<std::filesystem::path>& splits,
                                    std::size_t most = 0);

}  // namespace anigen::io
