#include "anigen/train/anymate_stage.h"

#include <algorithm>
#include <utility>

#include "anigen/core/log.h"
#include "anigen/models/anymate/connectivity.h"
#include "anigen/models/anymate/joint_denoiser.h"
#include "anigen/models/anymate/joint_regression.h"
#include "anigen/models/anymate/joint_volume.h"
#include "anigen/models/anymate/skinning.h"
#include "anigen/train/anymate_pretrained.h"
#include "anigen/train/loss_generator.h"

namespace anigen::train {
namespace {

using torch::Tensor;
namespace anymate = models::anymate;

Losses one_loss(const char* name, const Tensor& loss) { return {loss, {{name, loss}}}; }

// What a sample must bring for the task.
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
                           loaders::AnymateDatasets data, std::string model_name, torch::Device device)
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

Losses AnymateStage::losses(const loaders::Batch& batch, const LossContext& context) {
  torch::manual_seed(loss_generator(context, "anymate").current_seed());
  const auto& samples = dynamic_cast<const loaders::AnymateDraws&>(batch).samples;
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
  auto data_options = loaders::AnymateDatasetOptions::read(dataset_args);
  dataset_args.finish();
  dataset.finish();
  data_options.cells |= anymate::task_of(model_options.decoder) == anymate::Task::kJointVolume;

  const loaders::AnymateDatasets data = loaders::open_anymate(data_options, trainer.seed);
  log::info("{} samples to train on, {} held out", data.train->samples(), data.held_out ? data.held_out->samples() : 0);
  return std::make_unique<AnymateStage>(model_options, options, data, model.name, device);
}

}  // namespace anigen::train
