#include "anigen/generate/rignet_rigger.h"

#include <memory>
#include <string>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/generate/learned_rigging.h"
#include "anigen/geometry/correspondence.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/rignet/dataset.h"
#include "anigen/rignet/skeleton.h"

namespace anigen::generate {

namespace {

namespace fs = std::filesystem;
using rignet::RignetModel;
using rignet::RignetOptions;

void require_rignet_task(const std::optional<TrainedRignetModel>& trained, rignet::Task wanted) {
  if (!trained || trained->model->options().task == wanted) return;
  throw InputError(trained->file.string(), "",
                   "this model is for " + name_of(trained->model->options().task) + ", not for " + name_of(wanted));
}

}  // namespace

TrainedRignetModel load_rignet_model(const fs::path& path, torch::Device device) {
  const nn::RunModel found = model_at(path, kRignetModelClass);
  const std::string config = found.config.string();
  TrainedRignetModel trained;
  trained.file = found.checkpoint;
  trained.model = naming(found.config, [&] {
    return RignetModel(RignetOptions::from_json(found.args, config, found.pointer), nn::Init::kNone);
  });
  nn::load_state_dict(*trained.model, io::read_state_dict(found.checkpoint), nn::LoadMode::kStrict,
                      found.checkpoint.string());
  ConfigReader top(found.run, config);
  ConfigReader dataset = top.object("dataset");
  ConfigReader args = dataset.object("args");
  trained.mesh = rignet::read_rignet_mesh_options(args);
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
  require_rignet_task(models.joints, rignet::Task::kJoints);
  require_rignet_task(models.connectivity, rignet::Task::kConnectivity);
  require_rignet_task(models.skin, rignet::Task::kSkinning);
}

namespace {

using torch::Tensor;
using JointPlaces = std::vector<Eigen::Vector3d>;

/// Weights of the graph's vertices as rows over joints. @param weights [V, K] @param heads [K] joints
SkinWeights rows_of_heads(const Tensor& weights, const std::vector<int>& heads) {
  const Tensor all = weights.contiguous();
  const float* next = all.data_ptr<float>();
  SkinWeights skin;
  for (std::int64_t v = 0; v < all.size(0); ++v) {
    std::vector<Influence> row;
    for (const int head : heads) row.push_back({head, *next++});
    skin.append_row(std::move(row));
  }
  return skin;
}

void require_finite(const Tensor& values, const TrainedRignetModel& model) {
  if (values.isfinite().all().item<bool>()) return;
  throw InputError(model.file.string(), "", "this model gives numbers that are not finite");
}

}  // namespace

struct RignetRigger::Seen {
  rignet::RignetMesh mesh;
  rignet::SurfacePaths paths;
  rignet::MeshGraph graph;  ///< on the CPU
};

RignetRigger::RignetRigger(RignetModels models, const RignetRiggerOptions& options)
    : models_(std::move(models)), options_(options) {
  require_tasks(models_);
}

RignetRigger::Seen RignetRigger::seen(const io::RiggedShape& shape, const TrainedRignetModel& by) const {
  if (!shape.has_surface()) throw InputError(shape.file, "", "holds no surface to rig");
  rignet::RignetMesh mesh = rignet::rignet_mesh(shape.mesh.vertices, shape.mesh.faces, by.mesh.most_vertices);
  rignet::SurfacePaths paths(mesh, by.mesh.geodesic_samples, options_.seed);
  rignet::MeshGraph graph = rignet::mesh_graph(mesh, paths, options_.seed);
  return {std::move(mesh), std::move(paths), std::move(graph)};
}

std::vector<Eigen::Vector3d> RignetRigger::predicted(const io::RiggedShape& shape) {
  TrainedRignetModel& trained = *models_.joints;
  const Seen looked = seen(shape, trained);
  const auto displaced = trained.model->network<rignet::JointNetworkImpl>().forward(looked.graph.to(options_.device));
  require_finite(displaced.points, trained);
  require_finite(displaced.attention_logits, trained);
  const rignet::SolidShape solid(shape.mesh.vertices, shape.mesh.faces);
  const Tensor joints = rignet::clustered_joints(displaced.points, torch::sigmoid(displaced.attention_logits),
                                                 solid.holds(displaced.points), rignet::clusters_of(*trained.model));
  JointPlaces places = nn::points_of<double>(joints, "joints");
  for (Eigen::Vector3d& place : places) place = looked.mesh.frame.out_of(place);
  return places;
}

std::vector<int> RignetRigger::parents_of(const io::RiggedShape& shape, const JointPlaces& joints) {
  TrainedRignetModel& trained = *models_.connectivity;
  const Seen looked = seen(shape, trained);
  const Tensor rows = rignet::position_rows(placed_in(looked.mesh.frame, joints));
  const auto ways =
      rignet::SolidShape(shape.mesh.vertices, shape.mesh.faces).ways(nn::points_of<double>(rows, "joints"));
  const auto input = rignet::connectivity_input({looked.graph}, {rows}, {ways.inside}, options_.device);
  return naming(trained.file, [&] { return rignet::predicted_tree(*trained.model, input, ways.outside).parents; });
}

rigging::ProposedJoints RignetRigger::propose(const io::RiggedShape& shape, const rigging::JointProposer& given) {
  const torch::NoGradGuard no_grad;
  if (!shape.has_surface()) throw InputError(shape.file, "", "holds no surface to rig");
  JointModels steps;
  if (models_.joints) steps.predict = [&] { return predicted(shape); };
  if (models_.connectivity) steps.connect = [&](const JointPlaces& joints) { return parents_of(shape, joints); };
  return propose_by_models(shape, given, steps);
}

SkinWeights RignetRigger::bind(const io::RiggedShape& shape, const Skeleton& skeleton) {
  const torch::NoGradGuard no_grad;
  TrainedRignetModel& trained = models_.skin.value();
  const Seen looked = seen(shape, trained);
  const Tensor joints = rignet::position_rows(placed_in(looked.mesh.frame, skeleton.positions()));
  const RigBones bones =
      models_.joints ? bones_between(joints, skeleton.parents) : bones_of_rig(joints, skeleton.parents);
  const std::size_t vertices = shape.mesh.vertices.size();
  if (bones.heads.empty()) return from_dense(std::vector<float>(vertices, 1.0F), vertices, 1);

  const rignet::BoneEnds ends{nn::points_of<double>(bones.bones.narrow(1, 0, 3), "bones"),
                              nn::points_of<double>(bones.bones.narrow(1, 3, 3), "bones")};
  const rignet::RignetOptions& model = trained.model->options();
  const rignet::BoneSlots slots =
      rignet::bone_slots(rignet::volumetric_distances(looked.mesh, looked.paths, ends), ends, model.bones);
  const Tensor weights =
      rignet::predicted_weights(*trained.model, looked.graph.to(options_.device), slots.to(options_.device),
                                static_cast<std::int64_t>(bones.heads.size()));
  require_finite(weights, trained);
  const Tensor cleaned = rignet::cleaned_weights(weights, looked.graph.ring, model.least_weight);

  Mesh graph_mesh;
  graph_mesh.vertices = looked.mesh.vertices;
  graph_mesh.faces = looked.mesh.faces;
  std::vector<Eigen::Vector3f> places;
  for (const Eigen::Vector3f& vertex : shape.mesh.vertices) {
    places.emplace_back(looked.mesh.frame.into(vertex.cast<double>()).cast<float>());
  }
  const SkinWeights skin = geometry::transfer_attributes(graph_mesh, rows_of_heads(cleaned, bones.heads), places).skin;
  return options_.most_influences == 0 ? skin : limit_influences(skin, options_.most_influences);
}

rigging::LearnedSteps rignet_steps(RignetModels models, const RignetRiggerOptions& options) {
  const bool proposes = models.joints || models.connectivity, binds = models.skin.has_value();
  return learned_steps(std::make_shared<RignetRigger>(std::move(models), options), proposes, binds);
}

}  // namespace anigen::generate
