#include "anigen/train/stages/anymate.h"

#include <algorithm>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "anigen/anymate/denoisers.h"
#include "anigen/anymate/heads.h"
#include "anigen/anymate/joints.h"
#include "anigen/anymate/volumes.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/train/stage.h"

namespace anigen::train {

namespace {

namespace fs = std::filesystem;

// KeyPlace of a part of the encoder in files of others.
struct KeyPlace {
  const char *theirs, *ours;
};

std::vector<KeyPlace> places(anymate::EncoderKind kind) {
  switch (kind) {
    case anymate::EncoderKind::kBert:
      return {{"model.point_backbone.", "encoder."}};
    case anymate::EncoderKind::kMichelangelo:
      return {{"model.shape_model.", "encoder."}, {"model.shape_projection", "encoder.shape_projection"}};
    default:
      throw NotSupportedError("", "/trainer/args/pretrained_encoder",
                              "pretrained weights of the encoder 'transformer': there are none");
  }
}

std::vector<fs::path> parts(const fs::path& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) return {path};
  std::vector<fs::path> pickled, safe;
  fs::directory_iterator entries(path, error);
  for (; !error && entries != fs::directory_iterator(); entries.increment(error)) {
    const std::string name = entries->path().filename().string(), extension = entries->path().extension().string();
    if (extension == ".bin" && name.rfind("pytorch_model", 0) == 0) pickled.push_back(entries->path());
    if (extension == ".safetensors" && name.rfind("model", 0) == 0) safe.push_back(entries->path());
  }
  if (error) throw InputError(path.string(), "", "the folder cannot be read: " + error.message());
  std::vector<fs::path>& files = safe.empty() ? pickled : safe;
  std::sort(files.begin(), files.end());
  return files;
}

io::NamedArrays encoder_arrays(anymate::EncoderKind kind, const fs::path& path) {
  io::NamedArrays found;
  for (const fs::path& file : parts(path)) {
    for (const KeyPlace& place : places(kind)) {
      for (auto& [key, array] : io::read_state_below(file, place.theirs)) {
        found.emplace_back(place.ours + key, std::move(array));
      }
    }
  }
  if (found.empty()) {
    throw InputError(path.string(), "",
                     std::string("has no tensor '") + places(kind).front().theirs +
                         "…', which trainer.args.pretrained_encoder is to name");
  }
  return found;
}

// The columns that a narrower input layer has go before those that the model has beside them.
void widen_input(const torch::nn::Module& model, io::NamedArrays& arrays) {
  constexpr const char* kKey = "encoder.encoder.input_proj.weight";
  constexpr std::int64_t kHarmonics = 25;
  const auto found = std::find_if(arrays.begin(), arrays.end(), [](const auto& entry) { return entry.first == kKey; });
  if (found == arrays.end()) return;
  for (const nn::StateEntry& entry : nn::state_entries(model)) {
    if (entry.key != kKey) continue;
    const torch::Tensor narrow = nn::to_tensor(found->second).to(torch::kFloat32);
    const torch::Tensor own = entry.tensor.detach().to(torch::kCPU, torch::kFloat32);
    if (narrow.dim() != 2 || narrow.size(0) != own.size(0) || narrow.size(1) + kHarmonics != own.size(1)) return;
    found->second = nn::to_array(torch::cat({narrow, own.narrow(1, narrow.size(1), own.size(1) - narrow.size(1))}, 1));
  }
}

void require_all(const torch::nn::Module& model, const io::NamedArrays& arrays, const fs::path& path) {
  std::set<std::string> there;
  for (const auto& entry : arrays) there.insert(entry.first);
  for (const nn::StateEntry& entry : nn::state_entries(model)) {
    if (entry.key.rfind("encoder.", 0) == 0 && there.count(entry.key) == 0) {
      throw InputError(path.string(), entry.key, "the encoder's tensor is not among the pretrained weights");
    }
  }
}

}  // namespace

void load_pretrained_encoder(anymate::AnymateModelImpl& model, const fs::path& path) {
  io::NamedArrays arrays = encoder_arrays(model.options().encoder, path);
  widen_input(model, arrays);
  require_all(model, arrays, path);
  nn::load_state_dict(model, arrays, nn::LoadMode::kNonStrict, path.string());
  log::info("{}: the encoder starts from pretrained weights", path.string());
}

namespace {

using torch::Tensor;

}  // namespace

void AnymateScores::add(const anymate::AnymateSample& sample, std::uint64_t index) {
  const torch::NoGradGuard no_grad;
  const anymate::AnymateBatch batch = anymate::collate({sample}, {sample.joints.size(0), sample.bones.size(0)});
  const Tensor latents = model_.encode(batch.points_cloud.to(device_));
  switch (anymate::task_of(model_.options().decoder)) {
    case anymate::Task::kConnectivity:
      return add_connectivity(batch, latents);
    case anymate::Task::kSkinning:
      return add_skinning(batch, latents);
    default:
      return add_joints(sample, latents, index);
  }
}

void AnymateScores::add_joints(const anymate::AnymateSample& sample, const Tensor& latents, std::uint64_t index) {
  anymate::JointPrediction options;
  options.train_steps = train_steps_;
  options.noise = torch::randn({1, joints_, 3}, nn::numbered_generator(0, "anymate held-out noise", index)).to(device_);
  options.cells = sample.vox;
  const Tensor predicted = anymate::predicted_joints(model_, latents, options);
  scores_.add_joints(sample.name, nn::points_of<double>(predicted, "predicted"),
                     nn::points_of<double>(sample.joints, "joints"));
}

void AnymateScores::add_connectivity(const anymate::AnymateBatch& batch, const Tensor& latents) {
  const Tensor logits = model_.decoder<anymate::ConnectivityImpl>().forward(latents, batch.joints.to(device_),
                                                                            batch.joints_mask.to(device_));
  const metrics::SkinMatrix chances = matrix_of(logits[0].softmax(-1));
  scores_.add_connectivity(batch.names.front(), chances, chances, matrix_of(batch.conns[0]),
                           nn::points_of<double>(batch.joints[0], "joints"));
}

void AnymateScores::add_skinning(const anymate::AnymateBatch& batch, const Tensor& latents) {
  if (!batch.skins.defined()) throw InputError("", batch.names.front() + "/skins_index", "the sample has no weights");
  anymate::SkinningInput input;
  input.latents = latents;
  input.points = batch.points_cloud.to(device_);
  input.bones = batch.bones.to(device_);
  input.mask = batch.bones_mask.to(device_);
  const Tensor predicted = model_.decoder<anymate::SkinningImpl>().forward(input)[0].softmax(-1);
  scores_.add_skinning(batch.names.front(), predicted, batch.skins[0], batch.points_cloud[0].narrow(1, 0, 3),
                       batch.bones[0]);
}

namespace {

using torch::Tensor;

Losses one_loss(const char* name, const Tensor& loss) { return {loss, {{name, loss}}}; }

// Requirements on a sample for the task.
void require_parts(const anymate::AnymateSample& sample, anymate::Task task) {
  if (task == anymate::Task::kSkinning && !sample.skins_index.defined()) {
    throw InputError("", sample.name + "/skins_index", "the sample has no skin weights to learn from");
  }
  if (task == anymate::Task::kJointVolume && !sample.vox.defined()) {
    throw InputError("", sample.name + "/vox", "the sample has no cells to ask the field about");
  }
}

}  // namespace

AnymateStageOptions AnymateStageOptions::read(ConfigReader& args) {
  AnymateStageOptions options;
  options.num_train_step = args.integer("num_train_step", options.num_train_step, 1, 100000);
  options.num_training_points = args.integer("num_training_points", options.num_training_points, 1, 65536);
  options.skin_points = args.integer("skin_points", options.skin_points, 1, 1 << 20);
  options.field_cells = args.integer("field_cells", options.field_cells, 1, 1 << 18);
  options.eval_max_assets = args.integer("eval_max_assets", 0, 0);
  options.pretrained_encoder = args.text("pretrained_encoder", "");
  return options;
}

AnymateStage::AnymateStage(const anymate::ModelOptions& model, const AnymateStageOptions& options,
                           anymate::AnymateDatasets data, std::string model_name, torch::Device device)
    : RigStage("Anymate", data.held_out ? data.held_out->samples() : 0, options.eval_max_assets),
      options_(options),
      data_(std::move(data)),
      model_name_(std::move(model_name)),
      device_(device),
      model_(model) {
  model_->to(device_);
}

void AnymateStage::warm_start(const LoadedKeys&) {
  if (!options_.pretrained_encoder.empty()) load_pretrained_encoder(*model_, options_.pretrained_encoder);
}

Losses AnymateStage::losses(const data::Batch& batch, const LossContext& context) {
  torch::manual_seed(loss_generator(context, "anymate").current_seed());
  const auto& samples = dynamic_cast<const anymate::AnymateDraws&>(batch).samples;
  const anymate::Task task = anymate::task_of(model_->options().decoder);
  for (const anymate::AnymateSample& sample : samples) require_parts(sample, task);
  if (task == anymate::Task::kDenoisedJoints) {
    const auto drawn = anymate::collate_diffusion(samples, options_.num_training_points);
    const Tensor latents = model_->encode(drawn.points_cloud.to(device_));
    const anymate::DdimSchedule schedule(options_.num_train_step);
    return one_loss("mse", anymate::denoising_term(model_->decoder<anymate::JointDenoiserImpl>(), schedule,
                                                   drawn.joints_repeat.to(device_), latents)
                               .loss);
  }
  anymate::AnymateBatch collated = anymate::collate(samples);
  const Tensor latents = model_->encode(collated.points_cloud.to(device_));
  switch (task) {
    case anymate::Task::kJointVolume: {
      std::vector<Tensor> cells, joints;
      for (const anymate::AnymateSample& sample : samples) {
        cells.push_back(anymate::training_voxels(sample.vox, options_.field_cells));
        joints.push_back(sample.joints);
      }
      return one_loss("bce",
                      anymate::joint_volume_loss(model_->decoder<anymate::JointVolumeImpl>(), latents, cells, joints));
    }
    case anymate::Task::kConnectivity: {
      const Tensor logits = model_->decoder<anymate::ConnectivityImpl>().forward(latents, collated.joints.to(device_),
                                                                                 collated.joints_mask.to(device_));
      return one_loss("ce", anymate::connectivity_loss(logits, collated.conns.to(device_)));
    }
    case anymate::Task::kSkinning: {
      const std::int64_t points = collated.points_cloud.size(1);
      const Tensor rows = anymate::training_points(points, std::min(points, options_.skin_points));
      anymate::SkinningInput input;
      input.latents = latents;
      input.points = collated.points_cloud.index_select(1, rows).to(device_);
      input.bones = collated.bones.to(device_);
      input.mask = collated.bones_mask.to(device_);
      const auto losses = anymate::skinning_losses(model_->decoder<anymate::SkinningImpl>().forward(input),
                                                   collated.skins.index_select(1, rows).to(device_));
      return {losses.cos_clamp, {{"cos_clamp", losses.cos_clamp}, {"ce", losses.ce}}};
    }
    default:
      return one_loss("chamfer",
                      anymate::joint_chamfer_loss(model_->decoder<anymate::JointRegressionImpl>().forward(latents),
                                                  collated.joints.to(device_), collated.joints_num));
  }
}

RigScores AnymateStage::scores(std::size_t assets) {
  model_->eval();
  AnymateScores scores(*model_, options_.num_train_step, options_.num_training_points, device_);
  for (std::size_t i = 0; i < assets; ++i) scores.add(data_.held_out->sample(i), i);
  model_->train();
  return scores.scores();
}

std::unique_ptr<Stage> make_anymate_stage(const Json& config, const std::string& file, ConfigReader& trainer_args,
                                          const TrainerOptions& trainer, torch::Device device) {
  const auto options = AnymateStageOptions::read(trainer_args);
  require_one_replica(trainer, file, "Anymate");
  ConfigReader top(config, file);
  const OnlyModel model = read_only_model(top, "AnymateModel");
  const auto model_options = anymate::ModelOptions::from_json(*model.args, file, model.pointer);
  if (!options.pretrained_encoder.empty()) {
    constexpr const char* kPlace = "/trainer/args/pretrained_encoder";
    if (model_options.encoder == anymate::EncoderKind::kScratch) {
      throw InputError(file, kPlace, "there are no pretrained weights of the encoder 'transformer'");
    }
    if (trainer.finetune_ckpt.count(model.name) > 0) {
      throw InputError(file, kPlace, "finetune_ckpt names weights of the whole model already");
    }
  }

  ConfigReader dataset = top.object("dataset");
  dataset.require("name");
  dataset.choice("name", "", {"Anymate"});
  ConfigReader dataset_args = dataset.object("args");
  auto data_options = anymate::AnymateDatasetOptions::read(dataset_args);
  dataset_args.finish();
  dataset.finish();
  data_options.cells |= anymate::task_of(model_options.decoder) == anymate::Task::kJointVolume;

  const anymate::AnymateDatasets data = anymate::open_anymate(data_options, trainer.seed);
  log::info("{} samples to train on, {} held out", data.train->samples(), data.held_out ? data.held_out->samples() : 0);
  return std::make_unique<AnymateStage>(model_options, options, data, model.name, device);
}

}  // namespace anigen::train
