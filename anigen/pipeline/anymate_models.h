#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>

#include "anigen/models/anymate/model.h"
#include "anigen/pipeline/learned_models.h"

namespace anigen::pipeline {

/// What the config of a run calls the class of all of Anymate's models.
inline constexpr const char* kAnymateModelClass = "AnymateModel";

/// One of Anymate's models for use: evaluation mode, nothing asks for gradients. And what its training says about it;
/// the defaults are the released values (reference anymate-baselines.md, 3.2).
struct TrainedAnymateModel {
  models::anymate::AnymateModel model = nullptr;
  std::filesystem::path file;          ///< of the weights, for messages
  std::int64_t points = 8192;          ///< of a surface that it saw at a time
  std::int64_t train_steps = 100;      ///< levels of noise, of a denoiser
  std::int64_t denoised_joints = 128;  ///< of a denoiser
};

/// Reads a model, weights strictly:
///  - a run folder, config.json with a model "AnymateModel" and ckpts/: the newest weights, averaged (EMA) where there
///    are averages (models/run_model.h);
///  - a `.safetensors` file in such a folder or in its ckpts/, or anywhere under a name as released ones have;
///  - a checkpoint as released (`.pth.tar`, `.pt`, `.pth`): options from its `model_config`, without one from its name
///    (models::anymate::ModelOptions::from_checkpoint_name).
/// @throws InputError naming the file: when there is nothing of the kind, or arguments or weights do not fit
TrainedAnymateModel load_anymate_model(const std::filesystem::path& path, torch::Device device);

/// Models of Anymate by what they are to do.
struct AnymateModels {
  std::optional<TrainedAnymateModel> joints, connectivity, skin;
};

/// @throws InputError as load_anymate_model, and for a model of another task than its place
AnymateModels load_anymate_models(const LearnedModelFiles& files, torch::Device device);

/// @throws InputError naming the file of a model that is for another task than its place
void require_tasks(const AnymateModels& models);

}  // namespace anigen::pipeline
