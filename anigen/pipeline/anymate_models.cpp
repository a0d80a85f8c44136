#include "anigen/pipeline/anymate_models.h"

#include <system_error>
#include <utility>

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"
#include "anigen/io/safetensors.h"
#include "anigen/io/torch_archive.h"
#include "anigen/models/run_model.h"
#include "anigen/models/state_dict.h"
#include "anigen/pipeline/learned_models.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;
using models::anymate::AnymateModel;
using models::anymate::DecoderKind;
using models::anymate::ModelOptions;
using models::anymate::Task;

constexpr std::int64_t kMostNumber = 1 << 24;

TrainedAnymateModel model_of(const ModelOptions& options, io::NamedArrays&& weights, const fs::path& file,
                             const fs::path& described_by, torch::Device device) {
  TrainedAnymateModel trained;
  trained.file = file;
  trained.model = naming(described_by, [&] { return AnymateModel(options, nn::Init::kNone); });
  models::load_state_dict(*trained.model, std::move(weights), models::LoadMode::kStrict, file.string());
  for (const torch::Tensor& parameter : trained.model->parameters()) torch::Tensor(parameter).requires_grad_(false);
  trained.model->to(device);
  trained.model->eval();
  return trained;
}

std::int64_t count_of(ConfigReader reader, const std::string& key, std::int64_t fallback) {
  return reader.integer(key, fallback, 1, kMostNumber);
}

void read_denoising(const ConfigReader& reader, TrainedAnymateModel& trained) {
  trained.train_steps = count_of(reader, "num_train_step", trained.train_steps);
  trained.denoised_joints = count_of(reader, "num_training_points", trained.denoised_joints);
}

TrainedAnymateModel of_run(const models::RunModel& found, torch::Device device) {
  const std::string config = found.config.string();
  const auto options = naming(found.config, [&] { return ModelOptions::from_json(found.args, config, found.pointer); });
  TrainedAnymateModel trained =
      model_of(options, io::read_state_dict(found.checkpoint), found.checkpoint, found.config, device);
  ConfigReader top(found.run, config);
  trained.points = count_of(top.object("dataset").object("args"), "points", trained.points);
  read_denoising(top.object("trainer").object("args"), trained);
  return trained;
}

TrainedAnymateModel of_safetensors(const fs::path& file, torch::Device device) {
  const fs::path run = run_around(file);
  if (!run.empty()) {
    models::RunModel found = models::find_run_model(run, kAnymateModelClass, file.stem().string());
    found.checkpoint = file;
    return of_run(found, device);
  }
  const std::string name = file.filename().string();
  const auto options = naming(file, [&] { return ModelOptions::from_checkpoint_name(name); });
  return model_of(options, io::read_safetensors(file).tensors, file, file, device);
}

TrainedAnymateModel of_archive(const fs::path& file, torch::Device device) {
  io::TorchCheckpoint checkpoint = io::read_torch_checkpoint(file, "model_config");
  const Json& config = checkpoint.config;
  const std::string pointer = "/model_config";
  const auto options = naming(file, [&] {
    return config.is_null() ? ModelOptions::from_checkpoint_name(file.filename().string())
                            : ModelOptions::from_json(config, file.string(), pointer);
  });
  TrainedAnymateModel trained = model_of(options, std::move(checkpoint.state), file, file, device);
  if (!config.is_null()) read_denoising(ConfigReader(config, file.string(), pointer), trained);
  return trained;
}

const char* words_for(Task task) {
  switch (task) {
    case Task::kConnectivity:
      return "connectivity";
    case Task::kSkinning:
      return "skinning";
    default:
      return "joints";
  }
}

void require_task(const std::optional<TrainedAnymateModel>& trained, Task wanted) {
  if (!trained) return;
  const DecoderKind decoder = trained->model->options().decoder;
  const std::string found = words_for(models::anymate::task_of(decoder));
  if (found == words_for(wanted)) return;
  throw InputError(trained->file.string(), "",
                   "its decoder '" + name_of(decoder) + "' is for " + found + ", not for " + words_for(wanted));
}

}  // namespace

TrainedAnymateModel load_anymate_model(const fs::path& path, torch::Device device) {
  std::error_code error;
  if (fs::is_directory(path, error)) return of_run(models::find_run_model(path, kAnymateModelClass), device);
  if (!fs::is_regular_file(path, error)) {
    throw InputError(path.string(), "", "there is no such run folder or checkpoint of one of Anymate's models");
  }
  const std::string extension = path.extension().string();
  if (extension == ".safetensors") return of_safetensors(path, device);
  if (extension == ".tar" || extension == ".pt" || extension == ".pth") return of_archive(path, device);
  throw NotSupportedError(path.string(), "", "checkpoints other than .pth.tar, .pt, .pth and .safetensors");
}

AnymateModels load_anymate_models(const LearnedModelFiles& files, torch::Device device) {
  AnymateModels models;
  if (!files.joints.empty()) models.joints = load_anymate_model(files.joints, device);
  if (!files.connectivity.empty()) models.connectivity = load_anymate_model(files.connectivity, device);
  if (!files.skin.empty()) models.skin = load_anymate_model(files.skin, device);
  require_tasks(models);
  return models;
}

void require_tasks(const AnymateModels& models) {
  require_task(models.joints, Task::kJointRegression);
  require_task(models.connectivity, Task::kConnectivity);
  require_task(models.skin, Task::kSkinning);
}

}  // namespace anigen::pipeline
