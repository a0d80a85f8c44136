#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/geometry/voxel_grid.h"

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

/// records/<id>.json: which steps are done for an asset, under which options, and what they found. Depends on the
/// asset, the options and the program only: no times, no paths, so that equal runs write equal bytes.
struct StepRecords {
  std::map<std::string, StepResult> steps;  ///< by name

  bool has(const std::string& step) const { return steps.count(step) > 0; }
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

/// Paths of the files of one asset in a dataset: the published names (reference training-and-data.md, 1.1) and our
/// own assets/ and records/.
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
class Step {
 public:
  virtual ~Step() = default;

  virtual std::string name() const = 0;
  /// Raised whenever the same input would give other bytes, so that old outputs are made again.
  virtual int version() const = 0;
  /// Names of the steps whose results this one uses.
  virtual std::vector<std::string> inputs() const { return {kImport}; }
  /// Everything besides its inputs that decides the outputs.
  virtual Json options() const { return Json::object(); }
  /// Files that exist when the step was done under these options of its own.
  virtual std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const = 0;
  /// Removes what an earlier run under other options left and this one may not overwrite.
  virtual void clear(const AssetPlaces& places) const;
  /// Writes the outputs, each by rename. @return the columns @throws InputError for an asset that cannot be used
  virtual Json run(AssetJob& job) const = 0;
};

/// Number and size of files. @return false when one is missing
bool measure_files(const std::vector<std::filesystem::path>& files, StepResult& result);

/// True when the record says that the step was done by this version on these inputs, and its outputs are there,
/// complete. @param any_options also takes what was made under other options of the step itself
bool up_to_date(const Step& step, const AssetPlaces& places, const StepRecords& records, bool any_options = false);

/// The files of a step that an asset's record names, under the options that the record holds; for whoever checks a
/// dataset without its plan, its sources or a feature extractor. Empty for a step that leaves none, or that this
/// version does not know.
std::vector<std::filesystem::path> recorded_files(const std::string& step, const Json& options,
                                                  const AssetPlaces& places);

/// Starts a new measurement of peak_memory_bytes(), where the kernel allows it; otherwise the peak is that of the
/// process since its start.
void reset_peak_memory();

/// Most memory that this process had in RAM, bytes (VmHWM); 0 when the kernel does not tell.
std::uint64_t peak_memory_bytes();

}  // namespace anigen::prepare
