#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/io/rigs/axes.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::io {

/// Where rigged shapes come from: one file, a folder of files, or a file with many samples.
class ShapeSource {
 public:
  virtual ~ShapeSource() = default;

  /// What read() takes, each once: folders in alphabetical order, data sets in file order.
  virtual std::vector<std::string> ids() const = 0;
  /// Several threads may read at once. @throws InputError naming file and place, also for an id that is not there
  virtual RiggedShape read(const std::string& id) const = 0;
  /// One line for settings and reports: the format, how many, from where, and memory kept when it is much.
  virtual std::string describe() const = 0;

  /// Files that would be lost with this shape, for refuse_to_overwrite(): those that read() reads, what they refer to
  /// (files_read_with()), and the asset's own file in a data set. Some may not exist; none for a shape in memory.
  virtual std::vector<std::filesystem::path> files(const std::string& id) const;
  /// Further names of a shape that predictions and split files may go by (the uuid and the path that a data set keeps,
  /// a file's own name); read() takes ids only, NameIndex (split.h) finds the id.
  virtual std::vector<std::string> other_names(const std::string& id) const;
  /// The sha256 under which anigen-prepare would keep the shape: RigReader::content_id() of a file, content_id() of the
  /// arrays of a sample. Reads the file. Empty where there is none: for Articulation-XL without
  /// SourceOptions::content_ids, for meshes without a rig, and for data sets, whose ids it already is.
  /// @throws InputError when the file cannot be read
  virtual std::string sample_id(const std::string& id) const;
  /// False for a shape that its data set marks as one to leave alone (is_bad_skeleton); read() reads it all the same.
  virtual bool is_usable(const std::string& id) const;
  /// What kind of thing the shape is, where its data set says so, such as the family of a procedural creature; else
  /// empty.
  virtual std::string category(const std::string& id) const;
  /// True for one file that holds one shape: two of those are a pair whatever they are called.
  virtual bool is_single_file() const { return false; }
};

struct SourceOptions {
  Axes axes = Axes::kFormat;  ///< which way is up in the file, when it is not what its format says
  bool content_ids = false;   ///< sample_id() is wanted: costs a digest of everything that is read
  bool require_rig = true;    ///< false: glTF, FBX and COLLADA files without a skin are read, too
};

/// Opens what a path is about, told by its content:
///   - .glb/.gltf/.fbx/.dae, or a folder of those at any depth (glTF: Y up; the others say it themselves). Where it
///     holds files called mesh.glb beside generation.json, as anigen-generate writes them, only those count,
///     and NPZ files beside them do not;
///   - a data set folder with metadata.csv and skeleton/ (Z up; ids are its sha256 column);
///   - .npz with an object array of sample dictionaries, as Articulation-XL 2.0 has them (Z up; ids are uuids; read
///     whole and kept);
///   - .npz with plain arrays joints, parents, skin, vertices, faces as UniRig's raw_data.npz and our
///     skeleton_voxelized.npz have them, or a folder of those (Z up). Where a folder holds files called raw_data.npz,
///     only those count;
///   - text rigs, each beside an .obj, or a folder of those (Y up; text_rig.h);
///   - .pt sample lists of Anymate, or a folder of those (Y up; ids are their names).
/// Ids of files in a folder: the path below the folder without extension, such as "fish/manta"; but where every file
/// lies alone in a sub-folder of its own ("<id>/result.glb"), that sub-folder's path.
/// @throws InputError when nothing there can be read, a folder mixes formats, two files have one id, or an index
/// (metadata.csv, the list of samples) is damaged; damage of single shapes shows when they are read
std::unique_ptr<ShapeSource> open_source(const std::filesystem::path& path, const SourceOptions& options = {});

/// Opens a source for users who need surfaces only: glTF, FBX and COLLADA files need no skin; also an .obj (Y up), .ply
/// or .stl (Z up) without any rig, or a folder of those that holds nothing else. @throws InputError as open_source()
std::unique_ptr<ShapeSource> open_meshes(const std::filesystem::path& path, const SourceOptions& options = {});

}  // namespace anigen::io
