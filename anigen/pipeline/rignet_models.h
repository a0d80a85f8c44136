#pragma once
#include <filesystem>
#include <optional>

#include "anigen/loaders/rignet/rignet_samples.h"
#include "anigen/models/rignet/model.h"
#include "anigen/pipeline/learned_models.h"

namespace anigen::pipeline {

/// What the config of a run calls the class of all of RigNet's models.
inline constexpr const char* kRignetModelClass = "RignetModel";

/// One of RigNet's models for use: evaluation mode, nothing asks for gradients. And how its training made graphs of
/// meshes.
struct TrainedRignetModel {
  models::rignet::RignetModel model = nullptr;
  std::filesystem::path file;  ///< of the weights, for messages
  loaders::RignetMeshOptions mesh;
};

/// Reads a model of a run of anigen-train (model_at()), weights strictly. The published checkpoints have other keys.
/// @throws InputError naming the file: when there is nothing of the kind, or arguments or weights do not fit
TrainedRignetModel load_rignet_model(const std::filesystem::path& path, torch::Device device);

/// Models of RigNet by what they are to do.
struct RignetModels {
  std::optional<TrainedRignetModel> joints, connectivity, skin;
};

/// @throws InputError as load_rignet_model, and for a model of another task than its place
RignetModels load_rignet_models(const LearnedModelFiles& files, torch::Device device);

/// @throws InputError naming the file of a model that is for another task than its place
void require_tasks(const RignetModels& models);

}  // namespace anigen::pipeline
