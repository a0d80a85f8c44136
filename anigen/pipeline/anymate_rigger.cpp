#include "anigen/pipeline/anymate_rigger.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/fields/tensor_points.h"
#include "anigen/geometry/spanning_trees.h"
#include "anigen/geometry/surface_sampling.h"
#include "anigen/models/anymate/connectivity.h"
#include "anigen/models/anymate/predicted_joints.h"
#include "anigen/nn/generator.h"
#include "anigen/pipeline/anymate_skin.h"
#include "anigen/pipeline/learned_rigging.h"

namespace anigen::pipeline {
namespace {

namespace anymate = models::anymate;
using torch::Tensor;
using Positions = std::vector<Eigen::Vector3d>;

std::int64_t points_for(const TrainedAnymateModel& trained, const AnymateRiggerOptions& options) {
  return options.points > 0 ? options.points : trained.points;
}

/// How many points there must be, for the groups of Point-BERT or a run of the concatenating skinning.
std::int64_t fewest_points(const anymate::ModelOptions& options) {
  std::int64_t fewest = 1;
  if (options.encoder == anymate::EncoderKind::kBert) {
    fewest = std::max(options.bert.num_group, options.bert.group_size);
  }
  if (options.decoder == anymate::DecoderKind::kConcatSkinning) {
    fewest = std::max(fewest, options.concat_skinning.concat_num);
  }
  return fewest;
}

void require_points(const std::optional<TrainedAnymateModel>& trained, const AnymateRiggerOptions& options) {
  if (!trained) return;
  const std::int64_t fewest = fewest_points(trained->model->options()), points = points_for(*trained, options);
  if (points >= fewest) return;
  throw InputError(trained->file.string(), "",
                   "this model needs at least " + std::to_string(fewest) + " points of a surface, not " +
                       std::to_string(points) + " (--points)");
}

loaders::AnymateMesh seen(const io::RiggedShape& shape) {
  if (!shape.has_surface()) throw InputError(shape.file, "", "holds no surface to rig");
  return loaders::anymate_mesh(shape.mesh.vertices, shape.mesh.faces);
}

/// Positions of the shape's frame in Anymate's, [J, 3] fp32.
Tensor placed(const Positions& joints, const loaders::AnymateFrame& frame) {
  Tensor tensor = torch::empty({static_cast<std::int64_t>(joints.size()), 3});
  float* out = tensor.data_ptr<float>();
  for (const Eigen::Vector3d& joint : joints) {
    const Eigen::Vector3f position = frame.into(joint).cast<float>();
    out = std::copy_n(position.data(), 3, out);
  }
  return tensor;
}

}  // namespace

AnymateRigger::AnymateRigger(AnymateModels models, const AnymateRiggerOptions& options)
    : models_(std::move(models)), options_(options) {
  require_tasks(models_);
  for (const auto* model : {&models_.joints, &models_.connectivity, &models_.skin}) require_points(*model, options_);
}

Tensor AnymateRigger::surface(const loaders::AnymateMesh& mesh, const TrainedAnymateModel& seen_by) const {
  Rng rng(options_.seed, "anymate points");
  const auto count = static_cast<std::size_t>(points_for(seen_by, options_));
  const auto points = geometry::sample_surface(mesh.vertices, mesh.faces, count, rng);
  return loaders::surface_features(mesh, points).unsqueeze(0).to(options_.device);
}

Positions AnymateRigger::predicted(const loaders::AnymateMesh& mesh) {
  TrainedAnymateModel& trained = *models_.joints;
  anymate::JointPrediction prediction;
  prediction.eps = options_.eps;
  prediction.train_steps = trained.train_steps;
  prediction.denoised_joints = trained.denoised_joints;
  const anymate::Task task = anymate::task_of(trained.model->options().decoder);
  if (task == anymate::Task::kDenoisedJoints) {
    const at::Generator generator = nn::numbered_generator(options_.seed, "anymate noise", 0);
    prediction.noise = torch::randn({1, trained.denoised_joints, 3}, generator).to(options_.device);
  } else if (task == anymate::Task::kJointVolume) {
    prediction.cells = loaders::solid_cells(mesh);
  }
  const Tensor latents = trained.model->encode(surface(mesh, trained));
  Positions joints = fields::points_of<double>(predicted_joints(*trained.model, latents, prediction), "joints");
  if (joints.empty()) throw InputError(trained.file.string(), "", "this model finds no joint in the mesh");
  for (Eigen::Vector3d& joint : joints) joint = mesh.frame.out_of(joint);
  return joints;
}

std::vector<int> AnymateRigger::parents_of(const loaders::AnymateMesh& mesh, const Positions& joints) {
  TrainedAnymateModel& trained = *models_.connectivity;
  const Tensor positions = placed(joints, mesh.frame).unsqueeze(0).to(options_.device);
  const Tensor latents = trained.model->encode(surface(mesh, trained));
  const Tensor logits = trained.model->decoder<anymate::ConnectivityImpl>().forward(latents, positions)[0];
  const Tensor rows = torch::log_softmax(logits.to(torch::kCPU, torch::kFloat64), -1).contiguous();
  if (!rows.isfinite().all().item<bool>()) {
    throw InputError(trained.file.string(), "", "this model gives probabilities that are not finite");
  }
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return geometry::likeliest_tree(Eigen::Map<const Matrix>(rows.data_ptr<double>(), rows.size(0), rows.size(1)));
}

rig::ProposedJoints AnymateRigger::propose(const io::RiggedShape& shape, const rig::JointProposer& given) {
  const torch::NoGradGuard no_grad;
  const loaders::AnymateMesh mesh = seen(shape);
  JointModels steps;
  if (models_.joints) steps.predict = [&] { return predicted(mesh); };
  if (models_.connectivity) steps.connect = [&](const Positions& joints) { return parents_of(mesh, joints); };
  return propose_by_models(shape, given, steps);
}

SkinWeights AnymateRigger::bind(const io::RiggedShape& shape, const Skeleton& skeleton) {
  const torch::NoGradGuard no_grad;
  const loaders::AnymateMesh mesh = seen(shape);
  const Tensor joints = placed(skeleton.positions(), mesh.frame);
  const RigBones bones =
      models_.joints ? bones_between(joints, skeleton.parents) : bones_of_rig(joints, skeleton.parents);
  const std::size_t vertices = mesh.vertices.size();
  if (bones.heads.empty()) return from_dense(std::vector<float>(vertices, 1.0F), vertices, 1);
  const TrainedAnymateModel& trained = models_.skin.value();
  return anymate_skin(trained, surface(mesh, trained), loaders::vertex_features(mesh), bones, options_.most_influences);
}

rig::LearnedSteps anymate_steps(AnymateModels models, const AnymateRiggerOptions& options) {
  const bool proposes = models.joints || models.connectivity, binds = models.skin.has_value();
  return learned_steps(std::make_shared<AnymateRigger>(std::move(models), options), proposes, binds);
}

}  // namespace anigen::pipeline
