#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>

#include "anigen/anymate/dataset.h"
#include "anigen/anymate/model.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/generate/learned_rigging.h"
#include "anigen/nn/torch.h"
#include "anigen/rigging/rig_meshes.h"

namespace anigen::generate {

/// Class name of Anymate's models in the config of a run.
inline constexpr const char* kAnymateModelClass = "AnymateModel";

/// One of Anymate's models for use: evaluation mode, nothing asks for gradients. And what its training says about it;
/// the defaults are the released values (docs/reference/anymate.md, 3.2).
struct TrainedAnymateModel {
  anymate::AnymateModel model = nullptr;
  std::filesystem::path file;          ///< of the weights, for messages
  std::int64_t points = 8192;          ///< of a surface that it saw at a time
  std::int64_t train_steps = 100;      ///< levels of noise, of a denoiser
  std::int64_t denoised_joints = 128;  ///< of a denoiser
};

/// Reads a model, weights strictly:
///  - a run folder, config.json with a model "AnymateModel" and ckpts/: the newest weights, averaged (EMA) where there
///    are averages (nn/state_dict.h);
///  - a `.safetensors` file in such a folder or in its ckpts/, or anywhere under a name as released ones have;
///  - a checkpoint as released (`.pth.tar`, `.pt`, `.pth`): options from its `model_config`, without one from its name
///    (anymate::ModelOptions::from_checkpoint_name).
/// @throws InputError naming the file: when there is nothing of the kind, or arguments or weights do not fit
TrainedAnymateModel load_anymate_model(const std::filesystem::path& path, torch::Device device);

using AnymateModels = RiggerModels<TrainedAnymateModel>;

/// @throws InputError as load_anymate_model, and for a model of another task than its place
AnymateModels load_anymate_models(const LearnedModelFiles& files, torch::Device device);

/// Skin weights of vertices, a block of them at a time, which does not change them.
/// @param cloud [1, N, 6] what the encoder looks at @param vertices [V, 6] (anymate::vertex_features), on the CPU
/// @param bones at least one @return of each bone the share that the softmax gives it, without shares below 1e-4
/// @throws InputError naming the model's file when weights are not finite
SkinWeights anymate_skin(const TrainedAnymateModel& skinning, const torch::Tensor& cloud, const torch::Tensor& vertices,
                         const RigBones& bones);

struct AnymateRiggerOptions {
  std::int64_t points = 0;             ///< of the surface that encoders look at; 0: as many as each was trained with
  double eps = 0.0;                    ///< joints this near become one, in a box of side 2; 0: as released
  std::size_t joints = 0;              ///< that a denoiser starts from, and so the most it finds; 0: as in training
  std::uint64_t seed = 0;              ///< of the points, and of what a denoiser starts from
  std::size_t most_influences = 4;     ///< joints per vertex; 0: any number
  torch::Device device = torch::kCPU;  ///< where the models are
};

/// Anymate as a rigger of meshes (Deng et al. 2025; docs/reference/anymate.md, 5.3). Predicted joints are merged;
/// parents are the likeliest tree (asset/skeleton.h) under the model for connectivity; weights are anymate_skin()'s.
class AnymateRigger : public LearnedRigger {
 public:
  /// @throws InputError naming its file for a model that is for another task than its place, or needs more points
  AnymateRigger(AnymateModels models, const AnymateRiggerOptions& options);

 private:
  torch::Tensor surface(const anymate::AnymateMesh& mesh, const TrainedAnymateModel& seen_by) const;
  std::vector<Eigen::Vector3d> predicted(const io::RiggedShape& shape) override;
  std::vector<int> parents_of(const io::RiggedShape& shape, const std::vector<Eigen::Vector3d>& joints) override;
  SkinWeights weights_of(const io::RiggedShape& shape, const Skeleton& skeleton) override;

  AnymateModels models_;
  AnymateRiggerOptions options_;
};

}  // namespace anigen::generate
