#include "anigen/generate/rignet_rigger.h"

#include <string>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/geometry/correspondence.h"
#include "anigen/nn/init.h"
#include "anigen/rignet/skeleton.h"

namespace anigen::generate {

namespace {

using torch::Tensor;
using JointPlaces = std::vector<Eigen::Vector3d>;

std::string task_word(const TrainedRignetModel& trained) {
  const rignet::Task task = trained.model->options().task;
  return task == rignet::Task::kSkinning ? "skinning" : name_of(task);
}

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

}  // namespace

TrainedRignetModel load_rignet_model(const std::filesystem::path& path, torch::Device device) {
  const nn::RunModel found = model_at(path, kRignetModelClass);
  TrainedRignetModel trained;
  trained.file = found.checkpoint;
  trained.model =
      data::naming(found.config.string(), [&] { return nn::load_trained<rignet::RignetModel>(found, device); });
  ConfigReader args = ConfigReader(found.run, found.config.string()).object("dataset").object("args");
  trained.mesh = rignet::read_rignet_mesh_options(args);
  return trained;
}

RignetModels load_rignet_models(const LearnedModelFiles& files, torch::Device device) {
  return load_rigger_models<TrainedRignetModel>(
      files, [&](const std::filesystem::path& path) { return load_rignet_model(path, device); }, task_word);
}

struct RignetRigger::Seen {
  rignet::RignetMesh mesh;
  rignet::SurfacePaths paths;
  rignet::MeshGraph graph;  ///< on the CPU
};

RignetRigger::RignetRigger(RignetModels models, const RignetRiggerOptions& options)
    : LearnedRigger(models, options.most_influences), models_(std::move(models)), options_(options) {
  require_tasks(models_, task_word);
}

RignetRigger::Seen RignetRigger::seen(const io::RiggedShape& shape, const TrainedRignetModel& by) const {
  rignet::RignetMesh mesh = rignet::rignet_mesh(shape.mesh.vertices, shape.mesh.faces, by.mesh.most_vertices);
  rignet::SurfacePaths paths(mesh, by.mesh.geodesic_samples, options_.seed);
  rignet::MeshGraph graph = rignet::mesh_graph(mesh, paths, options_.seed);
  return {std::move(mesh), std::move(paths), std::move(graph)};
}

std::vector<Eigen::Vector3d> RignetRigger::predicted(const io::RiggedShape& shape) {
  TrainedRignetModel& trained = *models_.joints;
  const Seen looked = seen(shape, trained);
  const auto displaced = trained.model->network<rignet::JointNetworkImpl>().forward(looked.graph.to(options_.device));
  require_finite(displaced.points, trained.file);
  require_finite(displaced.attention_logits, trained.file);
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
  const Tensor rows = placed_in(looked.mesh.frame, joints);
  const auto ways =
      rignet::SolidShape(shape.mesh.vertices, shape.mesh.faces).ways(nn::points_of<double>(rows, "joints"));
  const auto input = rignet::connectivity_input({looked.graph}, {rows}, {ways.inside}, options_.device);
  return data::naming(trained.file.string(),
                      [&] { return rignet::predicted_tree(*trained.model, input, ways.outside).parents; });
}

SkinWeights RignetRigger::weights_of(const io::RiggedShape& shape, const Skeleton& skeleton) {
  TrainedRignetModel& trained = models_.skin.value();
  const Seen looked = seen(shape, trained);
  const RigBones bones = bones_of(placed_in(looked.mesh.frame, skeleton.positions()), skeleton.parents);
  const rignet::BoneEnds ends{nn::points_of<double>(bones.bones.narrow(1, 0, 3), "bones"),
                              nn::points_of<double>(bones.bones.narrow(1, 3, 3), "bones")};
  const rignet::RignetOptions& model = trained.model->options();
  const rignet::BoneSlots slots =
      rignet::bone_slots(rignet::volumetric_distances(looked.mesh, looked.paths, ends), ends, model.bones);
  const Tensor weights =
      rignet::predicted_weights(*trained.model, looked.graph.to(options_.device), slots.to(options_.device),
                                static_cast<std::int64_t>(bones.heads.size()));
  require_finite(weights, trained.file);
  const Tensor cleaned = rignet::cleaned_weights(weights, looked.graph.ring, model.least_weight);

  Mesh graph_mesh;
  graph_mesh.vertices = looked.mesh.vertices;
  graph_mesh.faces = looked.mesh.faces;
  std::vector<Eigen::Vector3f> places;
  for (const Eigen::Vector3f& vertex : shape.mesh.vertices)
    places.emplace_back(looked.mesh.frame.into(vertex.cast<double>()).cast<float>());
  return geometry::transfer_attributes(graph_mesh, rows_of_heads(cleaned, bones.heads), places).skin;
}

}  // namespace anigen::generate
