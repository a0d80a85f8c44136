#include "anigen/generate/anymate_rigger.h"

#include <algorithm>
#include <string>
#include <system_error>
#include <utility>

#include "anigen/anymate/heads.h"
#include "anigen/anymate/joints.h"
#include "anigen/asset/skeleton.h"
#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/core/random.h"
#include "anigen/core/run_folder.h"
#include "anigen/geometry/sampling.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"

namespace anigen::generate {

namespace {

namespace fs = std::filesystem;
using anymate::AnymateModel;
using anymate::DecoderKind;
using anymate::ModelOptions;
using anymate::Task;

constexpr std::int64_t kMostNumber = 1 << 24;

TrainedAnymateModel model_of(const ModelOptions& options, io::NamedArrays&& weights, const fs::path& file,
                             const fs::path& described_by, torch::Device device) {
  TrainedAnymateModel trained;
  trained.file = file;
  trained.model = data::naming(described_by.string(), [&] { return AnymateModel(options, nn::Init::kNone); });
  nn::load_state_dict(*trained.model, std::move(weights), nn::LoadMode::kStrict, file.string());
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

TrainedAnymateModel of_run(const nn::RunModel& found, torch::Device device) {
  const std::string config = found.config.string();
  const auto options = data::naming(config, [&] { return ModelOptions::from_json(found.args, config, found.pointer); });
  TrainedAnymateModel trained =
      model_of(options, io::read_state_dict(found.checkpoint), found.checkpoint, found.config, device);
  ConfigReader top(found.run, config);
  trained.points = count_of(top.object("dataset").object("args"), "points", trained.points);
  read_denoising(top.object("trainer").object("args"), trained);
  return trained;
}

TrainedAnymateModel of_safetensors(const fs::path& file, torch::Device device) {
  if (RunFolder::around(file)) return of_run(model_at(file, kAnymateModelClass), device);
  const std::string name = file.filename().string();
  const auto options = data::naming(file.string(), [&] { return ModelOptions::from_checkpoint_name(name); });
  return model_of(options, io::read_safetensors(file).tensors, file, file, device);
}

TrainedAnymateModel of_archive(const fs::path& file, torch::Device device) {
  io::TorchCheckpoint checkpoint = io::read_torch_checkpoint(file, "model_config");
  const Json& config = checkpoint.config;
  const std::string pointer = "/model_config";
  const auto options = data::naming(file.string(), [&] {
    return config.is_null() ? ModelOptions::from_checkpoint_name(file.filename().string())
                            : ModelOptions::from_json(config, file.string(), pointer);
  });
  TrainedAnymateModel trained = model_of(options, std::move(checkpoint.state), file, file, device);
  if (!config.is_null()) read_denoising(ConfigReader(config, file.string(), pointer), trained);
  return trained;
}

std::string word_for(const TrainedAnymateModel& trained) {
  switch (anymate::task_of(trained.model->options().decoder)) {
    case Task::kConnectivity:
      return "connectivity";
    case Task::kSkinning:
      return "skinning";
    default:
      return "joints";
  }
}

using anymate::SkinningImpl;
using anymate::SkinningInput;
using torch::Tensor;

constexpr std::int64_t kSkinnedAtOnce = 65536;
constexpr double kLeastShare = 1e-4;  // as generation does (decoded_asset.h): a softmax is nowhere zero

void append_rows(const Tensor& shares, const std::vector<int>& heads, SkinWeights& skin) {
  const float* next = shares.data_ptr<float>();
  // With very many bones all shares may be small; of each row the largest stays.
  const auto least = static_cast<float>(std::min(kLeastShare, 0.5 / static_cast<double>(heads.size())));
  for (std::int64_t v = 0; v < shares.size(0); ++v) {
    std::vector<Influence> row;
    for (const int head : heads) {
      const float share = *next++;
      if (share >= least) row.push_back({head, share});
    }
    skin.append_row(std::move(row));
  }
}

/// Logits of the bones at any points of a shape that was encoded once.
class BoneLogits {
 public:
  BoneLogits(anymate::AnymateModel model, const Tensor& cloud, const RigBones& bones)
      : model_(std::move(model)), decoder_(model_->decoder<SkinningImpl>()) {
    input_.latents = model_->encode(cloud);
    input_.bones = bones.bones.unsqueeze(0).to(cloud.device());
    if (model_->options().decoder != DecoderKind::kConcatSkinning) return;
    // This head knows whole runs of points of the surface only.
    const std::int64_t run = model_->options().concat_skinning.concat_num;
    input_.points = cloud.slice(1, 0, cloud.size(1) / run * run);
    of_points_ = decoder_.forward(input_)[0].cpu();
  }

  /// @param vertices [V, 6] on the CPU @return [V, K] on the CPU
  Tensor at(const Tensor& vertices) {
    if (of_points_.defined()) {
      const Tensor points = input_.points[0].slice(1, 0, 3).cpu();
      return anymate::nearest_point_logits(vertices.slice(1, 0, 3), points, of_points_);
    }
    input_.points = vertices.unsqueeze(0).to(input_.latents.device());
    return decoder_.forward(input_)[0].cpu();
  }

 private:
  anymate::AnymateModel model_;
  SkinningImpl& decoder_;
  SkinningInput input_;
  Tensor of_points_;
};

using Positions = std::vector<Eigen::Vector3d>;

std::int64_t points_for(const TrainedAnymateModel& trained, const AnymateRiggerOptions& options) {
  return options.points > 0 ? options.points : trained.points;
}

/// Least number of points, for the groups of Point-BERT or a run of the concatenating skinning.
std::int64_t fewest_points(const anymate::ModelOptions& options) {
  std::int64_t fewest = 1;
  if (options.encoder == anymate::EncoderKind::kBert)
    fewest = std::max(options.bert.num_group, options.bert.group_size);
  if (options.decoder == anymate::DecoderKind::kConcatSkinning)
    fewest = std::max(fewest, options.concat_skinning.concat_num);
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

anymate::AnymateMesh seen(const io::RiggedShape& shape) {
  return anymate::anymate_mesh(shape.mesh.vertices, shape.mesh.faces);
}

}  // namespace

TrainedAnymateModel load_anymate_model(const fs::path& path, torch::Device device) {
  std::error_code error;
  if (fs::is_directory(path, error)) return of_run(nn::find_run_model(path, kAnymateModelClass), device);
  if (!fs::is_regular_file(path, error))
    throw InputError(path.string(), "", "there is no such run folder or checkpoint of one of Anymate's models");
  const std::string extension = path.extension().string();
  if (extension == ".safetensors") return of_safetensors(path, device);
  if (extension == ".tar" || extension == ".pt" || extension == ".pth") return of_archive(path, device);
  throw NotSupportedError(path.string(), "", "checkpoints other than .pth.tar, .pt, .pth and .safetensors");
}

AnymateModels load_anymate_models(const LearnedModelFiles& files, torch::Device device) {
  return load_rigger_models<TrainedAnymateModel>(
      files, [&](const fs::path& path) { return load_anymate_model(path, device); }, word_for);
}

SkinWeights anymate_skin(const TrainedAnymateModel& skinning, const Tensor& cloud, const Tensor& vertices,
                         const RigBones& bones) {
  const torch::NoGradGuard no_grad;
  BoneLogits logits(skinning.model, cloud, bones);
  SkinWeights skin;
  for (const Tensor& block : vertices.split(kSkinnedAtOnce, 0)) {
    throw_if_interrupted();
    const Tensor shares = torch::softmax(logits.at(block).to(torch::kFloat32), -1).contiguous();
    require_finite(shares, skinning.file);
    append_rows(shares, bones.heads, skin);
  }
  return skin;
}

AnymateRigger::AnymateRigger(AnymateModels models, const AnymateRiggerOptions& options)
    : LearnedRigger(models, options.most_influences), models_(std::move(models)), options_(options) {
  require_tasks(models_, word_for);
  for (const auto* model : {&models_.joints, &models_.connectivity, &models_.skin}) require_points(*model, options_);
}

Tensor AnymateRigger::surface(const anymate::AnymateMesh& mesh, const TrainedAnymateModel& seen_by) const {
  Rng rng(options_.seed, "anymate points");
  const auto count = static_cast<std::size_t>(points_for(seen_by, options_));
  const auto points = geometry::sample_surface(mesh.vertices, mesh.faces, count, rng);
  return anymate::surface_features(mesh, points).unsqueeze(0).to(options_.device);
}

Positions AnymateRigger::predicted(const io::RiggedShape& shape) {
  const anymate::AnymateMesh mesh = seen(shape);
  TrainedAnymateModel& trained = *models_.joints;
  anymate::JointPrediction prediction;
  prediction.eps = options_.eps;
  prediction.train_steps = trained.train_steps;
  prediction.denoised_joints =
      options_.joints > 0 ? static_cast<std::int64_t>(options_.joints) : trained.denoised_joints;
  const anymate::Task task = anymate::task_of(trained.model->options().decoder);
  if (task == anymate::Task::kDenoisedJoints) {
    const at::Generator generator = nn::numbered_generator(options_.seed, "anymate noise", 0);
    prediction.noise = torch::randn({1, prediction.denoised_joints, 3}, generator).to(options_.device);
  } else if (task == anymate::Task::kJointVolume) {
    prediction.cells = anymate::solid_cells(mesh);
  }
  const Tensor latents = trained.model->encode(surface(mesh, trained));
  Positions joints = nn::points_of<double>(predicted_joints(*trained.model, latents, prediction), "joints");
  if (joints.empty()) throw InputError(trained.file.string(), "", "this model finds no joint in the mesh");
  for (Eigen::Vector3d& joint : joints) joint = mesh.frame.out_of(joint);
  return joints;
}

std::vector<int> AnymateRigger::parents_of(const io::RiggedShape& shape, const Positions& joints) {
  const anymate::AnymateMesh mesh = seen(shape);
  TrainedAnymateModel& trained = *models_.connectivity;
  const Tensor positions = placed_in(mesh.frame, joints).unsqueeze(0).to(options_.device);
  const Tensor latents = trained.model->encode(surface(mesh, trained));
  const Tensor logits = trained.model->decoder<anymate::ConnectivityImpl>().forward(latents, positions)[0];
  const Tensor rows = torch::log_softmax(logits.to(torch::kCPU, torch::kFloat64), -1).contiguous();
  require_finite(rows, trained.file);
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return likeliest_tree(Eigen::Map<const Matrix>(rows.data_ptr<double>(), rows.size(0), rows.size(1)));
}

SkinWeights AnymateRigger::weights_of(const io::RiggedShape& shape, const Skeleton& skeleton) {
  const anymate::AnymateMesh mesh = seen(shape);
  const RigBones bones = bones_of(placed_in(mesh.frame, skeleton.positions()), skeleton.parents);
  const TrainedAnymateModel& trained = models_.skin.value();
  return anymate_skin(trained, surface(mesh, trained), anymate::vertex_features(mesh), bones);
}

}  // namespace anigen::generate
