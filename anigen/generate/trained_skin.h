#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/core/config.h"
#include "anigen/eval/skin_baselines.h"
#include "anigen/rigging/rig_meshes.h"

namespace anigen::rigging {
class SkinFeatures;
}

namespace anigen::generate {

/// A correction of classical skin weights of ours (skin_correction/network.h) that anigen-train has trained, on the
/// CPU.
class TrainedSkin {
 public:
  /// @param run its folder, of which the newest averaged weights are taken
  /// @throws InputError when the run holds no such model, or its weights do not fit
  explicit TrainedSkin(const std::filesystem::path& run);
  ~TrainedSkin();
  TrainedSkin(const TrainedSkin&) = delete;
  TrainedSkin& operator=(const TrainedSkin&) = delete;

  /// Binds by heat and by geodesic voxels and corrects the two.
  /// @param mesh in the bind pose of the skeleton @param most_influences joints per vertex; 0: any number
  /// @return one row per vertex @throws InputError as rigging::SkinFeatures, or for weights that are not finite
  SkinWeights bind(const Mesh& mesh, const Skeleton& skeleton, std::size_t most_influences);

  /// The network's inputs of a mesh. @throws InputError as rigging::SkinFeatures
  std::unique_ptr<rigging::SkinFeatures> features(const Mesh& mesh, const Skeleton& skeleton) const;
  /// @param features of features() @param smoothing as skin_correction::corrected_weights()
  SkinWeights weights(const rigging::SkinFeatures& features, std::size_t most_influences, double smoothing);

  /// The fold of real rigs that the training has held out (data::SkeletonFold), "" for none.
  const std::string& fold() const;
  /// Signature of an asset's joint tree (tree_signature) in the dataset of the training, which decided its fold; ""
  /// where that dataset is not there, or not the asset in it. @throws InputError when it cannot be read
  std::string trained_signature(const std::string& id) const;
  /// SkinCorrectionOptions::smoothing.
  double smoothing() const;

  /// The step of rig_meshes() that binds.
  static rigging::LearnedSteps steps(const std::shared_ptr<TrainedSkin>& skin, std::size_t most_influences);

 private:
  struct Loaded;
  std::unique_ptr<Loaded> loaded_;
};

/// Corrected weights as methods of a skin evaluation, and the classical ones that they correct: "learned",
/// "learned_smoothed" (half of the neighbours' mean, to be looked at before it is used), "heat", "geovoxel";
/// and "fitted_heat", as `auto` binds. All with at most four influences. Where the runs held folds of the real rigs
/// out, each real rig is bound by the run whose fold holds its skeleton (that of the training's dataset, while it is
/// there), and creatures by the first run.
/// @param settings gets the runs @throws InputError for no run, a run without a fold beside others, two runs of one
/// fold, or folds of different numbers
std::vector<eval::SkinMethod> skin_correction_methods(const std::vector<std::filesystem::path>& runs, Json& settings);

}  // namespace anigen::generate
