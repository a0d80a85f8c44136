#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/core/error.h"
#include "anigen/io/arrays/ndarray.h"

namespace anigen::io {

/// The clips of a file with the skeleton that they move, joint axes and all.
struct RigClips {
  Skeleton skeleton;
  std::vector<Animation> animations;  ///< at least one
};

/// Contents of one file about one object: any part may be missing, and each user says which ones it needs. Unlike Asset
/// it is not repaired: a forest stays one.
struct RiggedShape {
  std::string id;    ///< what predictions and ground truth are matched by
  std::string file;  ///< where it came from, for messages
  Mesh mesh;         ///< Z up, the file's unit; no faces: a point set
  std::vector<Material> materials;
  std::vector<EncodedImage> images;
  anigen::JointTree joints;              ///< checked; empty only when the file has no skeleton
  std::vector<std::string> joint_names;  ///< [J] or empty
  /// One row per vertex, or no rows when the file has no weights; without vertices, of the mesh that the rig is for.
  SkinWeights skin;
  /// Clip that moves the joints, which keep the skeleton's order; null without a clip. It stays as the file's format
  /// has it when the shape is turned or moved: `clips_turn` leads from there to the frame that the shape was read into.
  std::shared_ptr<const RigClips> clips;
  Eigen::Matrix3d clips_turn = Eigen::Matrix3d::Identity();
  std::size_t unweighted = 0;      ///< vertices without weights in the file, bound to the root
  double lowest_weight_sum = 1.0;  ///< of a vertex with weights in the file
  /// Vertices whose weights in the file do not sum to 1 within 0.01, in order; of files with arrays of weights (npz,
  /// shards, text), not of scenes such as GLB.
  std::vector<std::size_t> not_whole;
  std::vector<std::string> notes;  ///< what was repaired or left out while reading

  RiggedShape() = default;
  RiggedShape(std::string id, std::string file) : id(std::move(id)), file(std::move(file)) {}

  bool has_surface() const { return !mesh.faces.empty(); }
  bool has_joints() const { return joints.size() > 0; }
  bool has_skin() const { return skin.rows() > 0 && skin.rows() == mesh.vertices.size() && has_joints(); }
};

/// The asset's bind pose, and its clips.
RiggedShape rigged_shape(Asset asset, const std::string& id, const std::string& file);

/// Roots joined, parents moved before children, skin renumbered with them; joints keep their names as far as these are
/// unique. @throws InputError when there is no joint
Asset to_asset(const RiggedShape& shape);

/// Axis of a file that points up. Everything is turned to Z up on reading.
enum class Axes { kFormat, kYUp, kZUp };

/// "format", "y-up" or "z-up". @throws InputError on another word
Axes parse_axes(const std::string& word);
const char* name_of(Axes axes);

/// Turns vertices, normals and joints from a Y-up frame to ours: (x, y, z) → (x, −z, y), as the glTF import does.
void from_y_up(RiggedShape& shape);
/// The inverse, (x, y, z) → (x, z, −y): takes back what an import did to a file that was Z up all along.
void to_y_up(RiggedShape& shape);

/// @param format what the reader assumes: the shape still has the file's numbers, and is turned to Z up
void turn_to_z_up(RiggedShape& shape, Axes wanted, Axes format);

/// The named arrays of one sample, checked while they are taken: every refusal is an InputError that names the file
/// and the array.
class ArrayFields {
 public:
  /// @param file for messages; where a file has many samples, with the sample
  ArrayFields(const NamedArrays& arrays, std::string file) : arrays_(arrays), file_(std::move(file)) {}

  const std::string& file() const { return file_; }
  bool has(const std::string& name) const { return find(arrays_, name) != nullptr; }
  /// Of these names the first that is there, else an empty string.
  std::string first_of(const std::vector<std::string>& names) const;

  /// The array with this shape, -1 standing for any size.
  const NdArray& array(const std::string& name, const std::vector<std::int64_t>& shape) const;
  const NdArray& array(const std::string& name) const {
    if (!has(name)) fail(name, "the array is missing");
    return *find(arrays_, name);
  }
  /// Its first size. @throws InputError for a scalar
  std::int64_t rows(const std::string& name) const {
    if (array(name).shape.empty()) fail(name, "is one number, expected an array");
    return array(name).shape[0];
  }

  /// Three columns from `first` on of [n, >= first + 3], finite. Vector: Eigen::Vector3f or Vector3d
  template <typename Vector = Eigen::Vector3f>
  std::vector<Vector> points(const std::string& name, std::size_t first = 0) const;
  /// As above of [n, any], whatever they hold; empty when there are fewer columns.
  template <typename Vector = Eigen::Vector3f>
  std::vector<Vector> unchecked_points(const std::string& name, std::size_t first) const;
  /// Whole numbers of this shape.
  std::vector<std::int32_t> integers(const std::string& name, const std::vector<std::int64_t>& shape) const;
  std::int32_t integer(const std::string& name) const;
  /// Numbers of this shape; may be NaN.
  std::vector<float> reals(const std::string& name, const std::vector<std::int64_t>& shape) const {
    return array(name, shape).as<float>();
  }
  /// [F, 3] with every corner in [0, vertices).
  std::vector<Triangle> triangles(const std::string& name, std::size_t vertices) const;

  [[noreturn]] void fail(const std::string& place, const std::string& problem) const {
    throw InputError(file_, place, problem);
  }

 private:
  const NamedArrays& arrays_;
  std::string file_;
};

/// Collects weights in any order and makes rows of them that SkinWeights allows, saying what had to be repaired.
class SkinRows {
 public:
  /// @param file for messages
  SkinRows(std::size_t vertices, std::size_t joints, std::string file)
      : file_(std::move(file)), joints_(joints), rows_(vertices) {}

  /// Weights given twice for a vertex and joint add up. Weights below zero are left out and counted.
  /// @param place for messages @throws InputError when vertex or joint is out of range or the weight is not finite
  void add(std::int64_t vertex, std::int64_t joint, float weight, const std::string& place);

  /// The shape's skin: every row divided by its sum. A row without a positive weight becomes weight 1 on `fallback`, as
  /// the published SkinAE trainer does with joint 0 (docs/reference/autoencoders.md, 2.3). The shape's notes get a
  /// sentence for each kind of repair with how many vertices it touched; sums within 0.01 of 1 are rounding and not
  /// told.
  void finish(std::int32_t fallback, RiggedShape& shape);

 private:
  std::string file_;
  std::size_t joints_;
  std::vector<std::vector<Influence>> rows_;
  std::size_t negative_ = 0;
};

/// The first joint without a parent, where vertices without weights go; 0 when there is no joint.
std::int32_t first_root(const anigen::JointTree& tree);

/// The shape's skin from an array [V, J] of its vertices and joints; repairs become notes.
/// @throws InputError when the sizes differ or a weight is not finite
void set_dense_skin(const ArrayFields& fields, const std::string& name, RiggedShape& shape);

/// Normals of any length as unit vectors; those without length or with NaN come from the faces. None is no error; a
/// wrong number of them is left out with a note, since nothing else depends on them.
void set_normals(RiggedShape& shape, std::vector<Eigen::Vector3f> normals);

/// A shape of this id and file with what the arrays `vertices`, `faces` and `normals_name` say; any may be missing.
RiggedShape shape_with_mesh(const ArrayFields& fields, const std::string& normals_name, const std::string& id,
                            const std::string& file);

/// Notes, once everything was read: no mesh, a point set, no skeleton, joints in one place, several roots, no skin.
void note_missing_parts(RiggedShape& shape);

/// A rigged glTF, FBX or COLLADA file, told by its extension, its import's notes kept. @param axes kZUp for files whose
/// writer did not turn Z up to the format's Y up: the import's turn is then taken back
/// @param require_rig false: a file in which nothing is skinned is read, too (ImportOptions::require_rig)
/// @throws InputError with file and place, also when nothing is skinned; NotSupportedError naming an extension
RiggedShape read_scene_shape(const std::filesystem::path& file, const std::string& id, Axes axes = Axes::kFormat,
                             bool require_rig = true);

/// Source of rigged shapes: one file, a folder of files, or a file with many samples.
class ShapeSource {
 public:
  virtual ~ShapeSource() = default;

  /// Entries for read(), each once: folders in alphabetical order, data sets in file order.
  virtual std::vector<std::string> ids() const = 0;
  /// Several threads may read at once. @throws InputError naming file and place, also for an id that is not there
  virtual RiggedShape read(const std::string& id) const = 0;
  /// One line for settings and reports: the format, how many, from where, and memory kept when it is much.
  virtual std::string describe() const = 0;

  /// Files that would be lost with this shape, for refuse_to_overwrite(): those that read() reads, what they refer to
  /// (files_read_with()), and the asset's own file in a data set. Some may not exist; none for a shape in memory.
  virtual std::vector<std::filesystem::path> files(const std::string&) const { return {}; }
  /// Further names of a shape that predictions and split files may go by (the uuid and the path that a data set keeps,
  /// a file's own name); read() takes ids only, NameIndex (split.h) finds the id.
  virtual std::vector<std::string> other_names(const std::string&) const { return {}; }
  /// The sha256 under which anigen-prepare would keep the shape: RigReader::content_id() of a file, content_id() of the
  /// arrays of a sample. Reads the file. Empty where there is none: for Articulation-XL without
  /// SourceOptions::content_ids, for meshes without a rig, and for data sets, whose ids it already is.
  /// @throws InputError when the file cannot be read
  virtual std::string sample_id(const std::string&) const { return {}; }
  /// False for a shape that its data set marks as one to leave alone (is_bad_skeleton); read() reads it all the same.
  virtual bool is_usable(const std::string&) const { return true; }
  /// Category of the shape, where its data set says so, such as the family of a procedural creature; else
  /// empty.
  virtual std::string category(const std::string&) const { return {}; }
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
///   - .npz with an object array of sample dictionaries, as Articulation-XL 2.0 has them (Z up; ids are uuids);
///   - .npz with plain arrays joints, parents, skin, vertices, faces as UniRig's raw_data.npz and our
///     skeleton_voxelized.npz have them, or a folder of those (Z up). Where a folder holds files called raw_data.npz,
///     only those count;
///   - text rigs, each beside an .obj, or a folder of those (Y up; text_rig.h);
///   - .pt sample lists of Anymate, or a folder of those (Y up; ids are their names);
///   - one sample of a file with many: FILE#SAMPLE, its id or its number from 0.
/// A folder may hold several of these formats, shards among them.
/// Ids of files in a folder: the path below the folder without extension, such as "fish/manta"; but where every file
/// lies alone in a sub-folder of its own ("<id>/result.glb"), that sub-folder's path.
/// @throws InputError when nothing there can be read, two shapes have one id, or an index
/// (metadata.csv, the list of samples) is damaged; damage of single shapes shows when they are read
std::unique_ptr<ShapeSource> open_source(const std::filesystem::path& path, const SourceOptions& options = {});

/// Opens a source for users who need surfaces only: glTF, FBX and COLLADA files need no skin; also an .obj (Y up), .ply
/// or .stl (Z up) without any rig, or a folder of those that holds nothing else. @throws InputError as open_source()
std::unique_ptr<ShapeSource> open_meshes(const std::filesystem::path& path, const SourceOptions& options = {});

}  // namespace anigen::io
