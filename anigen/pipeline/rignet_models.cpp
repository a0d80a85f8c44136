#include "anigen/pipeline/rignet_models.h"

#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/io/torch_archive.h"
#include "anigen/loaders/rignet/rignet_dataset.h"
#include "anigen/models/state_dict.h"
#include "anigen/pipeline/learned_models.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;
using models::rignet::RignetModel;
using models::rignet::RignetOptions;

void require_rignet_task(const std::optional<TrainedRignetModel>& trained, models::rignet::Task wanted) {
  if (!trained || trained->model->options().task == wanted) return;
  throw InputError(trained->file.string(), "",
                   "this model is for " + name_of(trained->model->options().task) + ", not for " + name_of(wanted));
}

}  // namespace

TrainedRignetModel load_rignet_model(const fs::path& path, torch::Device device) {
  const models::RunModel found = model_at(path, kRignetModelClass);
  const std::string config = found.config.string();
  TrainedRignetModel trained;
  trained.file = found.checkpoint;
  trained.model = naming(found.config, [&] {
    return RignetModel(RignetOptions::from_json(found.args, config, found.pointer), nn::Init::kNone);
  });
  models::load_state_dict(*trained.model, io::read_state_dict(found.checkpoint), models::LoadMode::kStrict,
                          found.checkpoint.string());
  ConfigReader top(found.run, config);
  ConfigReader dataset = top.object("dataset");
  ConfigReader args = dataset.object("args");
  trained.mesh = loaders::read_rignet_mesh_options(args);
  for (const torch::Tensor& parameter : trained.model->parameters()) torch::Tensor(parameter).requires_grad_(false);
  trained.model->to(device);
  trained.model->eval();
  return trained;
}

RignetModels load_rignet_models(const LearnedModelFiles& files, torch::Device device) {
  RignetModels models;
  if (!files.joints.empty()) models.joints = load_rignet_model(files.joints, device);
  if (!files.connectivity.empty()) models.connectivity = load_rignet_model(files.connectivity, device);
  if (!files.skin.empty()) models.skin = load_rignet_model(files.skin, device);
  require_tasks(models);
  return models;
}

void require_tasks(const RignetModels& models) {
  require_rignet_task(models.joints, models::rignet::Task::kJoints);
  require_rignet_task(models.connectivity, models::rignet::Task::kConnectivity);
  require_rignet_task(models.skin, models::rignet::Task::kSkinning);
}

}  // namespace anigen::pipeline
