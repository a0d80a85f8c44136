#include "anigen/train/stages/anymate.h"

#include <algorithm>
#include <set>

#include "anigen/anymate/dataset.h"
#include "anigen/anymate/denoisers.h"
#include "anigen/anymate/heads.h"
#include "anigen/anymate/joints.h"
#include "anigen/anymate/volumes.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/train/stages/rig_stage.h"

namespace anigen::train {

namespace {

namespace fs = std::filesystem;
using torch::Tensor;

// Place of a part of the encoder in the files of others.
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
      for (auto& [key, array] : io::read_state_below(file, place.theirs))
        found.emplace_back(place.ours + key, std::move(array));
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
    if (entry.key.rfind("encoder.", 0) == 0 && there.count(entry.key) == 0)
      throw InputError(path.string(), entry.key, "the encoder's tensor is not among the pretrained weights");
  }
}

Losses one_loss(const char* name, const Tensor& loss) { return {loss, {{name, loss}}}; }

// Requirements on a sample for the task.
void require_parts(const anymate::AnymateSample& sample, anymate::Task task) {
  if (task == anymate::Task::kSkinning && !sample.skins_index.defined())
    throw InputError("", sample.name + "/skins_index", "the sample has no skin weights to learn from");
  if (task == anymate::Task::kJointVolume && !sample.vox.defined())
    throw InputError("", sample.name + "/vox", "the sample has no cells to ask the field about");
}

class AnymateStage final
    : public RigStage<anymate::AnymateModel, anymate::AnymateDatasets, anymate::AnymateDraws, AnymateStageOptions> {
 public:
  AnymateStage(const anymate::ModelOptions& model, const AnymateStageOptions& options, anymate::AnymateDatasets data,
               std::string name, torch::Device device)
      : RigStage("Anymate", "anymate", model, options, std::move(data), std::move(name), device) {}

  void warm_start(const LoadedKeys&) override {
    if (!options_.pretrained_encoder.empty()) load_pretrained_encoder(*model_, options_.pretrained_encoder);
  }

 private:
  Losses loss(const Samples& samples, std::int64_t) override {
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
        return one_loss(
            "bce", anymate::joint_volume_loss(model_->decoder<anymate::JointVolumeImpl>(), latents, cells, joints));
      }
      case anymate::Task::kConnectivity: {
        const Tensor logits = model_->decoder<anymate::ConnectivityImpl>().forward(latents, collated.joints.to(device_),
                                                                                   collated.joints_mask.to(device_));
        const Tensor parents = collated.conns.to(device_);
        if (options_.connectivity_loss == "bce")
          return one_loss("bce", anymate::connectivity_bce(logits, parents, collated.joints_mask.to(device_)));
        return one_loss("ce", anymate::connectivity_loss(logits, parents));
      }
      case anymate::Task::kSkinning: {
        const std::int64_t points = collated.points_cloud.size(1);
        const Tensor rows = anymate::training_points(points, std::min(points, options_.skin_points));
        const anymate::SkinningInput input{latents, collated.points_cloud.index_select(1, rows).to(device_),
                                           collated.bones.to(device_), collated.bones_mask.to(device_)};
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

  void score(const anymate::AnymateSample& sample, std::uint64_t index, RigScores& scores) override {
    const anymate::AnymateBatch batch = anymate::collate({sample}, {sample.joints.size(0), sample.bones.size(0)});
    const Tensor latents = model_->encode(batch.points_cloud.to(device_));
    switch (anymate::task_of(model_->options().decoder)) {
      case anymate::Task::kConnectivity: {
        const Tensor logits = model_->decoder<anymate::ConnectivityImpl>().forward(latents, batch.joints.to(device_),
                                                                                   batch.joints_mask.to(device_));
        const metrics::SkinMatrix chances = matrix_of(logits[0].softmax(-1));
        return scores.add_connectivity(sample.name, chances, chances, matrix_of(batch.conns[0]),
                                       nn::points_of<double>(batch.joints[0], "joints"));
      }
      case anymate::Task::kSkinning: {
        if (!batch.skins.defined()) throw InputError("", sample.name + "/skins_index", "the sample has no weights");
        const anymate::SkinningInput input{latents, batch.points_cloud.to(device_), batch.bones.to(device_),
                                           batch.bones_mask.to(device_)};
        const Tensor predicted = model_->decoder<anymate::SkinningImpl>().forward(input)[0].softmax(-1);
        return scores.add_skinning(sample.name, predicted, batch.skins[0], batch.points_cloud[0].narrow(1, 0, 3),
                                   batch.bones[0]);
      }
      default: {
        anymate::JointPrediction options;
        options.train_steps = options_.num_train_step;
        const at::Generator generator = nn::numbered_generator(0, "anymate held-out noise", index);
        options.noise = torch::randn({1, options_.num_training_points, 3}, generator).to(device_);
        options.cells = sample.vox;
        const Tensor predicted = anymate::predicted_joints(*model_, latents, options);
        return scores.add_joints(sample.name, nn::points_of<double>(predicted, "predicted"),
                                 nn::points_of<double>(sample.joints, "joints"));
      }
    }
  }
};

}  // namespace

void load_pretrained_encoder(anymate::AnymateModelImpl& model, const fs::path& path) {
  io::NamedArrays arrays = encoder_arrays(model.options().encoder, path);
  widen_input(model, arrays);
  require_all(model, arrays, path);
  nn::load_state_dict(model, arrays, nn::LoadMode::kNonStrict, path.string());
  log::info("{}: the encoder starts from pretrained weights", path.string());
}

void AnymateStageOptions::fields(ConfigFields& f) {
  f("num_train_step", num_train_step, {1, 100000});
  f("num_training_points", num_training_points, {1, 65536});
  f("skin_points", skin_points, {1, 1 << 20});
  f("field_cells", field_cells, {1, 1 << 18});
  f("eval_max_assets", eval_max_assets, {0});
  f("connectivity_loss", connectivity_loss, {"ce", "bce"});
  f("pretrained_encoder", pretrained_encoder);
}

std::unique_ptr<Stage> make_anymate_stage(const StageRequest& request) {
  const auto options = AnymateStageOptions::read(request.args);
  require_one_replica(request, "Anymate");
  ConfigReader top(request.config, request.file);
  const auto [name, model] = read_only_model<anymate::ModelOptions>(top, {"AnymateModel"});
  if (!options.pretrained_encoder.empty()) {
    constexpr const char* kPlace = "/trainer/args/pretrained_encoder";
    if (model.encoder == anymate::EncoderKind::kScratch)
      throw InputError(request.file, kPlace, "there are no pretrained weights of the encoder 'transformer'");
    if (request.trainer.finetune_ckpt.count(name) > 0)
      throw InputError(request.file, kPlace, "finetune_ckpt names weights of the whole model already");
  }
  auto data = read_dataset<anymate::AnymateDatasetOptions>(top, "Anymate");
  data.cells |= anymate::task_of(model.decoder) == anymate::Task::kJointVolume;
  return std::make_unique<AnymateStage>(model, options, anymate::open_anymate(data, request.trainer.seed), name,
                                        request.device);
}

}  // namespace anigen::train
