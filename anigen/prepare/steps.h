#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/geometry/voxel_grid.h"
#include "anigen/prepare/cleaning.h"
#include "anigen/prepare/metadata.h"
#include "anigen/prepare/pose_augmentation.h"
#include "anigen/prepare/sources.h"

namespace anigen::prepare {

/// Result of one step for one asset.
struct StepResult {
  std::string fingerprint;          ///< see StepRecords::fingerprint()
  int version = 1;                  ///< of the step
  Json options = Json::object();    ///< of the step, as far as they decide its outputs
  std::vector<std::string> inputs;  ///< names of the steps whose results it used
  std::size_t files = 0;            ///< outputs
  std::uintmax_t bytes = 0;
  Json columns = Json::object();  ///< what it measured; the merge makes cells of metadata.csv from them
  std::string commit{};  ///< of the program that did it (core/version.h), for people: `version` decides what is kept
};
ANIGEN_JSON_RECORD(StepResult, fingerprint, version, options, inputs, files, bytes, columns, commit)

/// records/<id>.json: which steps are done for an asset, under which options, and what they found. Depends on the
/// asset, the options and the program only: no times, no paths, so that equal runs write equal bytes.
struct StepRecords {
  std::map<std::string, StepResult> steps;  ///< by name

  bool has(const std::string& step) const { return steps.count(step) > 0; }
  bool has_all(const std::vector<std::string>& inputs) const;
  /// Digest of everything that decided a step's outputs: its name, version and options, and the fingerprints of its
  /// inputs. @throws Error when an input is not done
  std::string fingerprint(const std::string& step, int version, const Json& options,
                          const std::vector<std::string>& inputs) const;
  /// Forgets every step whose inputs were made anew since, or are gone.
  void drop_stale();
  /// The columns of a step; an empty object when it is not done.
  const Json& columns(const std::string& step) const;
};

/// @return no steps when the file is absent, damaged, or of another version of this program
StepRecords read_step_records(const std::filesystem::path& file);
/// Atomic; steps in alphabetical order, whatever order they ran in.
void write_step_records(const std::filesystem::path& file, const std::string& id, const StepRecords& records);

/// Paths of the files of one asset in a dataset: the published names (docs/reference/training.md, 1.1) and our own
/// assets/ and records/.
struct AssetPlaces {
  std::filesystem::path out;
  std::string id;

  std::filesystem::path record() const { return out / "records" / (id + ".json"); }
  std::filesystem::path asset() const { return out / "assets" / (id + ".glb"); }
  std::filesystem::path skeleton() const { return out / "skeleton" / id / "skeleton_voxelized.npz"; }
  std::filesystem::path surface_voxels() const { return out / "voxels" / (id + ".ply"); }
  std::filesystem::path skeleton_voxels() const { return out / "voxels" / (id + "_skeleton.ply"); }
  std::filesystem::path views() const { return out / "renders" / id; }
  std::filesystem::path condition_views() const { return out / "renders_cond" / id; }
  std::filesystem::path features(const std::string& model) const { return out / "features" / model / (id + ".npz"); }
};

/// One asset on its way through the steps. The asset is read or posed only when the first step asks for it, so that
/// finding everything up to date costs no import; steps after that share it.
class AssetJob {
 public:
  /// @param load gives the normalised asset; called at most once
  AssetJob(AssetPlaces places, std::function<Asset()> load);

  const AssetPlaces& places() const { return places_; }
  const std::string& id() const { return places_.id; }
  /// @throws what load throws
  const Asset& asset();
  /// Transform that put the source into [-0.5, 0.5]³; known once the first step is done.
  const Similarity& normalisation() const { return normalisation_; }
  void set_normalisation(const Similarity& similarity) { normalisation_ = similarity; }
  /// The surface voxels as the voxel step wrote them. @throws InputError when the file is damaged
  const std::vector<geometry::Voxel>& surface_voxels(int resolution);
  /// After the voxel step wrote them anew.
  void forget_voxels() { voxels_.reset(); }

 private:
  AssetPlaces places_;
  std::function<Asset()> load_;
  std::optional<Asset> asset_;
  Similarity normalisation_;
  std::optional<std::vector<geometry::Voxel>> voxels_;
};

/// The step that every other one needs: the asset itself, imported or posed.
inline constexpr const char kImport[] = "import";

/// One node of the graph that turns an asset into what training reads. Steps hold options only; everything about an
/// asset comes with the job. Equal jobs and options give equal bytes.
struct Step {
  using Files = std::vector<std::filesystem::path>;

  std::string name;
  std::vector<std::string> inputs{kImport};  ///< names of the steps whose results this one uses
  Json options = Json::object();             ///< everything besides its inputs that decides the outputs
  /// Files that exist when the step was done under these options of its own.
  std::function<Files(const AssetPlaces& places, const Json& options)> outputs{};
  /// Writes the outputs, each by rename. @return the columns @throws InputError for an asset that cannot be used
  std::function<Json(AssetJob& job)> run{};
  /// Folder that the step owns: emptied before, since files of other options would stay. Unset: outputs are removed.
  std::function<std::filesystem::path(const AssetPlaces& places)> folder{};
  /// Raised whenever the same input would give other bytes, so that old outputs are made again.
  int version = 1;
  bool asked = true;  ///< false: only an input of another one; taken as it is when it is there

  /// Removes what an earlier run under other options left and this one may not overwrite.
  void clear(const AssetPlaces& places) const;
};

/// Number and size of files. @return false when one is missing
bool measure_files(const std::vector<std::filesystem::path>& files, StepResult& result);

/// True when the record says that the step was done by this version on these inputs, and its outputs are there,
/// complete. A step that nobody asked for may have been made under other options of its own.
bool up_to_date(const Step& step, const AssetPlaces& places, const StepRecords& records);

/// Starts a new measurement of peak_memory_bytes(), where the kernel allows it; otherwise the peak is that of the
/// process since its start.
void reset_peak_memory();

/// Most memory that this process had in RAM, bytes (VmHWM); 0 when the kernel does not tell.
std::uint64_t peak_memory_bytes();

/// `voxels/<id>.ply` and `voxels/<id>_skeleton.ply` of the published data set (docs/reference/training.md, 1.1): binary
/// PLY, little-endian, one element `vertex` with float x, y, z, the centres of the voxels. Equal sets give equal bytes:
/// rows are in lexicographic order. Atomic.
/// @param voxels in any order @param resolution R
/// @throws InputError without voxels, on a bad resolution, or when a voxel lies outside the grid
void write_voxel_ply(const std::filesystem::path& path, std::vector<geometry::Voxel> voxels, int resolution);

/// The voxels of such a file, ours or another program's (any PLY with x, y, z), as a set.
/// @throws InputError naming the file, and the row of a point that is in no voxel
std::vector<geometry::Voxel> read_voxel_ply(const std::filesystem::path& path, int resolution);

/// Rows one by one, in the file's order and with its repetitions: the order that features/<model>/<id>.npz follows.
std::vector<geometry::Voxel> read_voxel_rows(const std::filesystem::path& path, int resolution);

struct ViewSettings {
  std::size_t count = 0;
  int size = 512;            ///< pixels, square
  int samples_per_axis = 2;  ///< anti-aliasing
  bool geometry = false;     ///< also normals and depth
  bool front = false;        ///< conditions only: cameras in front (render::front_views) instead of all around
  std::uint64_t seed = 0;    ///< of camera positions, together with the asset's id; the plan's

  void fields(ConfigFields& f);
};

/// Steps to run on every asset.
struct StepPlan : JsonOptions<StepPlan> {
  /// Of step_words(). Empty: import, asset, skeleton and voxels, and whatever else has a number or a model below.
  std::vector<std::string> steps;
  bool keep_assets = true;  ///< without it, "asset" is not among the steps that an empty list means
  int resolution = 64;      ///< of voxels
  ViewSettings views, condition_views;
  FeatureOptions features;
  std::size_t variants = 0;  ///< posed variants of every asset
  PoseAugmentation poses;
  CleaningOptions cleaning;
  std::uint64_t seed = 0;  ///< of poses and cameras

  /// For workers and for the files that say how a dataset was made.
  void fields(ConfigFields& f);
  /// True when a word is among the steps, named or by default.
  bool wants(const std::string& word) const;
  /// @throws InputError naming the option: an unknown step, features without a model, sizes out of range
  void validate() const;
};

/// The words --only knows: import, asset, augment, skeleton, voxels, views, cond_views, features.
const std::vector<std::string>& step_words();

inline void to_json(Json& json, const StepPlan& plan) { json = plan.to_json(); }
inline void from_json(const Json& json, StepPlan& plan) { plan = StepPlan::from_json(json); }

/// The steps of a plan after the import, each after its inputs:
///
///     skeleton          skeleton/<id>/skeleton_voxelized.npz: joints, parents, dense weights and mesh
///     asset             assets/<id>.glb: the asset in the dataset's frame, with every influence and animation
///     voxels            voxels/<id>.ply and voxels/<id>_skeleton.ply: what the surface touches and what bones cross;
///                       columns num_voxels, num_skeleton_voxels
///     views             renders/<id>: NNN.png, transforms.json and mesh.ply, the normalised mesh that surface voxels
///                       are made of, from cameras all around (docs/reference/training.md, 1.1); with
///                       ViewSettings::geometry also NNN_normal.png (world normals, alpha is the mask) and
///                       NNN_depth.png (16 bits, render::kDepthUnits)
///     cond_views        renders_cond/<id>: NNN.png and transforms.json, from cameras of many focal lengths, for image
///                       conditions; with geometry also NNN_depth.png as above, and NNN_normal.png: the true normals in
///                       the form of the published normal estimator, which condition its first stage
///                       (render::encode_condition_normals)
///     features/<model>  features/<model>/<id>.npz: indices u8 [N, 3] and patchtokens f16 [N, C], rows in the order of
///                       voxels/<id>.ply; one dataset can hold the features of several models
/// @param extractor for the features, null when none are wanted
/// @throws InputError for features on a grid of more than 256, whose coordinates are not bytes
std::vector<Step> planned_steps(const StepPlan& plan, const std::shared_ptr<const FeatureExtractor>& extractor);

/// The files of a step that an asset's record names, under the options that the record holds; for whoever checks a
/// dataset without its plan, its sources or a feature extractor. Empty for a step that leaves none, or that this
/// version does not know.
std::vector<std::filesystem::path> recorded_files(const std::string& step, const Json& options,
                                                  const AssetPlaces& places);

/// The extractor that the plan wants; null when it wants no features. @param factory may be empty
/// @throws InputError, NotSupportedError when it cannot be made
std::shared_ptr<const FeatureExtractor> make_extractor(const StepPlan& plan, const FeatureExtractorFactory& factory);

}  // namespace anigen::prepare
