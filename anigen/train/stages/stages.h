#pragma once
#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/data/datasets.h"
#include "anigen/train/options.h"
#include "anigen/train/stage.h"

namespace anigen::train {

/// A config `{models, dataset, trainer}` from which a stage is made.
struct StageRequest {
  const Json& config;
  const std::string& file;        ///< of the config, for messages
  ConfigReader& args;             ///< `trainer.args`: a stage reads its own keys, whoever asks calls finish()
  const TrainerOptions& trainer;  ///< already read from the same arguments
  torch::Device device;
};

/// Stage 1: the skin auto-encoder learns to give back the skin weights it is shown (paper 3.3.1). Trainer
/// AniGenSkinAETrainer. Loss terms: "kl", "l1", "l2". Evaluation on held-out assets: "l1", mean over assets and
/// vertices of Σ_j |ŝ − s|, and "kl", of Σ_j s (log s − log ŝ), in nats. @throws InputError naming file and JSON
/// pointer, as all of these functions
std::unique_ptr<Stage> make_skin_autoencoder_stage(const StageRequest& request);

/// Stage 2, see SparseStructureAutoEncoderStage. Trainer AniGenSparseStructureVaeTrainer.
std::unique_ptr<Stage> make_sparse_structure_autoencoder_stage(const StageRequest& request);

/// Stage 3, see StructuredLatentAutoEncoderStage. Trainer AniGenSLatVaeSkeletonTrainer.
std::unique_ptr<Stage> make_structured_latent_autoencoder_stage(const StageRequest& request);

/// Stage 4: the sparse-structure flow learns the velocity from noise to the latents of stage 2 (paper 3.3.3). One time
/// per item, shared by both streams, independent noise; L = mse + mse_skl. Terms: "mse", "mse_skl", and both for every
/// tenth of the time axis that a micro-batch has items in, "bin_0.mse" … "bin_9.mse_skl".
///
/// Evaluation on held-out assets: "mse" and "mse_skl" at the times of eval_grid() with fixed noise and condition
/// views, the mean over assets and times. The same draws at every evaluation, so that its numbers can be compared.
/// samples.png: for some held-out assets (or training assets, where none is held out) the condition picture, a sample
/// with and one without guidance, and the asset's own latents decoded. From fixed noise.
///
/// Trainers AniGenImageConditionedFlowMatchingCFGTrainer, and AniGenFlowMatchingTrainer and
/// AniGenFlowMatchingCFGTrainer, which learn the same without pictures.
std::unique_ptr<Stage> make_sparse_structure_flow_stage(const StageRequest& request);

/// Stage 5: the structured-latent flow learns the velocity from noise to the latents of stage 3 on their voxels (paper
/// 3.4). As stage 4, but `mse` is the mean over geometry and skin channels together, and means are over the voxels of
/// the micro-batch: large assets weigh more, as published. Further terms, also of the evaluation: the parts "mse_geo"
/// and "mse_skin" of the first. The model is told the asset's number of joints where the config says so.
/// samples.png: the condition picture, a guided sample on the asset's own voxels, decoded, with its grouped skeleton
/// and with its weights, the asset's own latents decoded likewise, and the asset.
///
/// Trainers AniGenImageConditionedSparseFlowMatchingCFGTrainer, and AniGenSparseFlowMatchingTrainer and
/// AniGenSparseFlowMatchingCFGTrainer. @throws InputError also when channels of models, dataset and decoder differ
std::unique_ptr<Stage> make_structured_latent_flow_stage(const StageRequest& request);

/// The picture estimator, ours, learns what can be known of a condition picture (vision/picture_estimator.h). Trainer
/// AniGenPictureEstimatorTrainer, one model "PictureEstimator", the data set "AniGenPictures". Terms: "normals",
/// "coordinates", "camera", "family". Evaluation on held-out assets: "normals" in degrees and "coordinates" in units,
/// means over assets and pixels of the object; "yaw", the median error in degrees; "corners", the mean error of the
/// projected corners of the unit cube in sides of the picture; "family", the share that is right.
std::unique_ptr<Stage> make_picture_estimator_stage(const StageRequest& request);

/// The matting network, ours, learns the alpha of objects before other backgrounds (vision/matting.h). Trainer
/// AniGenMattingTrainer, one model "MattingUNet", the data set "AniGenMattings". L = λ_b BCE(logits, α) + λ_1 |p − α| +
/// λ_d (1 − Dice), p the sigmoid of the logits, Dice (2 Σ p α + 1) / (Σ p² + Σ α² + 1) of a picture; means over pixels
/// and pictures. Terms: "bce", "l1", "dice". Evaluation on held-out assets: means over assets of "iou", that of the
/// pixels above ½, and "mae", |p − α|.
std::unique_ptr<Stage> make_matting_stage(const StageRequest& request);

/// The correction of classical skin weights, ours, learns those of rigs (skin_correction/network.h). Trainer
/// AniGenSkinCorrectionTrainer, one model "SkinCorrection", the data set "AniGenSkinCorrections". L = λ_k KL + λ_1 ℓ1
/// of the candidates' weights, means over vertices. Terms: "kl", "l1". Evaluation on held-out assets, means over assets
/// of means over their kept vertices, each with at most four influences: "l1" and "kl" as in metrics/skin_metrics.h,
/// "heat_…" and "geovoxel_…" of the classical weights that are corrected, "missed", the true weight on joints that are
/// no candidates; where creatures are held out, too, "real_…" of the real rigs alone.
std::unique_ptr<Stage> make_skin_correction_stage(const StageRequest& request);

/// One of Anymate's models learns its task: joints, connectivity of given joints, or weights of given bones. The
/// decoder says which. Trainer AnymateTrainer, one model "AnymateModel" with the arguments of anymate::ModelOptions,
/// the data set "Anymate". Loss terms: "chamfer"; "mse"; "bce"; "ce"; "cos_clamp" with "ce". Evaluation: RigScores; of
/// joints also "skipped", the share of assets with fewer than two joints, in no mean.
std::unique_ptr<Stage> make_anymate_stage(const StageRequest& request);

/// One of RigNet's models learns its task. Trainer RignetTrainer, one model "RignetModel" with the arguments of
/// rignet::RignetOptions, the data set "Rignet". Loss terms: joints "chamfer", "attention", "clusters"; connectivity
/// "bone", "root"; skinning "ce". Evaluation: RigScores on the truth that Anymate's models are measured on. Joints are
/// read off as at inference. Parents are those of the published tree; the cross entropy is that of rows of BoneNet's
/// probabilities with RootNet's on the diagonal, divided by their sums. Weights are SkinNet's at vertices, before they
/// are cleaned (zeros would make any cross entropy), interpolated at Anymate's points of the surface.
std::unique_ptr<Stage> make_rignet_stage(const StageRequest& request);

/// The stage that a config's trainer names. @throws NotSupportedError naming those there are; InputError as above
std::unique_ptr<Stage> make_stage(const std::string& trainer_name, const StageRequest& request);

/// Places of the held-out assets that an evaluation looks at, at most so many, 0: all. They are spread evenly over the
/// table, which lists one source after the other.
inline std::vector<std::size_t> looked_at(std::size_t all, std::int64_t most) {
  const std::size_t count = most == 0 ? all : std::min(static_cast<std::size_t>(most), all);
  std::vector<std::size_t> places(count);
  for (std::size_t k = 0; k < count; ++k) places[k] = k * all / count;
  return places;
}

std::vector<torch::Tensor> on_device(const std::vector<torch::Tensor>& tensors, torch::Device device,
                                     std::optional<torch::Dtype> dtype = {});

/// `models.<name>`: {"name": one of the classes, "args": …}. @throws InputError
template <typename Options>
Options read_model(ConfigReader& models, const std::string& name, const std::vector<std::string>& classes) {
  models.require(name);
  ConfigReader model = models.object(name);
  model.require("name");
  model.choice("name", "", classes);
  const Json* args = model.raw("args");
  Options options = Options::from_json(args ? *args : Json::object(), models.file(), model.pointer_to("args"));
  model.finish();
  return options;
}

/// Name and options of the only model of a config. @throws InputError also when there is another number of them
template <typename Options>
std::pair<std::string, Options> read_only_model(ConfigReader& top, const std::vector<std::string>& classes) {
  top.require("models");
  ConfigReader models = top.object("models");
  const Json& list = *top.raw("models");
  if (list.size() != 1) throw models.error("", "this stage trains exactly one model");
  const std::string& name = list.begin().key();
  return {name, read_model<Options>(models, name, classes)};
}

/// `dataset`: {"name": this class, "args": …}. @throws InputError
template <typename Options>
Options read_dataset(ConfigReader& top, const std::string& class_name) {
  ConfigReader dataset = top.object("dataset");
  dataset.require("name");
  dataset.choice("name", "", {class_name});
  ConfigReader args = dataset.object("args");
  Options options = Options::read(args);
  args.finish();
  dataset.finish();
  return options;
}

}  // namespace anigen::train
