#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "anigen/generate/learned_rigging.h"
#include "anigen/rigging/rig_meshes.h"
#include "anigen/rignet/dataset.h"
#include "anigen/rignet/model.h"

namespace anigen::generate {

/// Class name of RigNet's models in the config of a run.
inline constexpr const char* kRignetModelClass = "RignetModel";

/// One of RigNet's models for use: evaluation mode, nothing asks for gradients; and how its training made graphs.
struct TrainedRignetModel {
  rignet::RignetModel model = nullptr;
  std::filesystem::path file;  ///< of the weights, for messages
  rignet::RignetMeshOptions mesh;
};

/// Reads a model of a run of anigen-train (model_at()), weights strictly. The published checkpoints have other keys.
/// @throws InputError naming the file: when there is nothing of the kind, or arguments or weights do not fit
TrainedRignetModel load_rignet_model(const std::filesystem::path& path, torch::Device device);

using RignetModels = RiggerModels<TrainedRignetModel>;

/// @throws InputError as load_rignet_model, and for a model of another task than its place
RignetModels load_rignet_models(const LearnedModelFiles& files, torch::Device device);

struct RignetRiggerOptions {
  std::uint64_t seed = 0;              ///< of the graphs' edges and samples
  std::size_t most_influences = 4;     ///< joints per vertex; 0: any number
  torch::Device device = torch::kCPU;  ///< where the models are
};

/// RigNet as a rigger of meshes (Xu et al. 2020; docs/reference/rignet.md), each mesh as a graph of the size that each
/// model was trained with. Parents are those of the published tree. Weights are SkinNet's at the graph's vertices,
/// cleaned (rignet::cleaned_weights), and at the shape's vertices those of the nearest place of the graph's surface.
class RignetRigger : public LearnedRigger {
 public:
  /// @throws InputError naming its file for a model that is for another task than its place
  RignetRigger(RignetModels models, const RignetRiggerOptions& options);

 private:
  struct Seen;
  Seen seen(const io::RiggedShape& shape, const TrainedRignetModel& by) const;
  std::vector<Eigen::Vector3d> predicted(const io::RiggedShape& shape) override;
  std::vector<int> parents_of(const io::RiggedShape& shape, const std::vector<Eigen::Vector3d>& joints) override;
  SkinWeights weights_of(const io::RiggedShape& shape, const Skeleton& skeleton) override;

  RignetModels models_;
  RignetRiggerOptions options_;
};

}  // namespace anigen::generate
