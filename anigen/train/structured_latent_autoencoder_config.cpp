// From a config to the stage of the structured-latent auto-encoder.
#include <algorithm>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/loaders/datasets/dataset_registry.h"
#include "anigen/loaders/files/pooled_voxels.h"
#include "anigen/models/lpips_weights.h"
#include "anigen/models/structured_latent_runs.h"
#include "anigen/train/structured_latent_autoencoder_stage.h"

namespace anigen::train {
namespace {

// Modules of the SkinAE in the two models.
constexpr const char* kSkinEncoderModule = "skin_encoder";
constexpr const char* kSkinDecoderModule = "skin_decoder";

template <typename Options>
Options read_latent_coder(ConfigReader& models, const std::string& name, const std::string& class_name) {
  models.require(name);
  ConfigReader model = models.object(name);
  model.require("name");
  model.choice("name", "", {class_name});
  const Json* args = model.raw("args");
  Options options =
      Options::from_json(args != nullptr ? *args : Json::object(), models.file(), model.pointer_to("args"));
  model.finish();
  return options;
}

void require_equal(std::int64_t decoder, std::int64_t encoder, const std::string& file, const std::string& key) {
  if (decoder == encoder) return;
  throw InputError(file, "/models/decoder/args/" + key,
                   std::to_string(decoder) + " differs from the encoder's " + std::to_string(encoder));
}

void drop(std::vector<std::string>& names, const std::string& name) {
  names.erase(std::remove(names.begin(), names.end(), name), names.end());
}

// "warm_start": "none" trains what published runs take from TRELLIS; the SkinAE, which stage 1 trained, stays frozen.
void unfreeze_all_but_skin(models::StructuredLatentCoderOptions& coder, const char* skin_module, bool skin_ae) {
  coder.modules_to_freeze.clear();
  coder.use_pretrain_branch = coder.freeze_pretrain_branch = skin_ae;
  if (skin_ae) coder.modules_to_freeze.emplace_back(skin_module);
}

// The first asset says whether models and dataset fit, before a run folder is touched.
void require_fitting_features(const loaders::BatchSource& data, const StructuredLatentCoders& coders,
                              const std::string& file) {
  const std::unique_ptr<loaders::Batch> batch = data.load({loaders::Draw{0, 0}});
  const auto& assets = dynamic_cast<const loaders::FeatureSkeletonBatch&>(*batch);
  const std::int64_t channels = assets.feats.feats.size(1);
  if (channels == coders.encoder.in_channels) return;
  throw InputError(file, "/models/encoder/args/in_channels",
                   std::to_string(coders.encoder.in_channels) + ", but the dataset's features have " +
                       std::to_string(channels) + " channels");
}

void say_what_is_left_out(const StructuredLatentAutoEncoderStage& stage,
                          const StructuredLatentAutoEncoderStageOptions& options) {
  if (!stage.trains_geometry()) {
    log::info("the geometry branch is frozen: nothing is rendered, and geo_loss and color_loss are left out");
  }
  if (options.variant.joint_skin) {
    log::info("skin_ae joint: the encoder sees no skin, and there are no features of a SkinAE to compare with");
  }
  if (options.variant.geometry_only) log::info("geometry_only: losses of skeleton and skin are left out");
}

}  // namespace

void StructuredLatentCoders::validate(const std::string& file) const {
  require_equal(decoder.resolution, encoder.resolution, file, "resolution");
  require_equal(decoder.latent_channels, encoder.latent_channels, file, "latent_channels");
  require_equal(decoder.latent_channels_skl, encoder.latent_channels_skl, file, "latent_channels_skl");
  require_equal(decoder.latent_channels_vertskin, encoder.latent_channels_vertskin, file, "latent_channels_vertskin");
  require_equal(decoder.skin_decoder_config.skin_feat_channels, encoder.skin_encoder_config.skin_feat_channels, file,
                "skin_decoder_config/skin_feat_channels");
}

std::unique_ptr<Stage> make_structured_latent_autoencoder_stage(const Json& config, const std::string& file,
                                                                ConfigReader& trainer_args,
                                                                const TrainerOptions& trainer, torch::Device device) {
  ConfigReader top(config, file);
  ConfigReader models = top.object("models");
  StructuredLatentCoders coders;
  coders.encoder = read_latent_coder<models::StructuredLatentEncoderOptions>(models, "encoder",
                                                                             models::kStructuredLatentEncoderClass);
  coders.decoder = read_latent_coder<models::StructuredLatentDecoderOptions>(models, "decoder",
                                                                             models::kStructuredLatentDecoderClass);
  models.finish();
  coders.validate(file);
  const auto options =
      StructuredLatentAutoEncoderStageOptions::read(trainer_args, coders.decoder, trainer.compatibility);
  options.variant.apply(coders.encoder, file);
  const bool skin_ae = options.variant.needs_skin_ae();
  if (!skin_ae) drop(coders.decoder.modules_to_freeze, kSkinDecoderModule);
  if (!options.warm_start.enabled) {
    unfreeze_all_but_skin(coders.encoder, kSkinEncoderModule, skin_ae);
    unfreeze_all_but_skin(coders.decoder, kSkinDecoderModule, skin_ae);
  }
  if (options.geometry.lambda_color > 0.0 && !coders.decoder.use_color) {
    throw trainer_args.error("lambda_color", "needs a decoder with representation_config.use_color");
  }

  ConfigReader dataset = top.object("dataset");
  dataset.require("name");
  dataset.choice("name", "", {"AniGenSparseFeat2Skeleton"});
  const loaders::Datasets data = loaders::make_datasets(top.object("dataset"), trainer.seed);
  const std::int64_t grid = top.object("dataset").object("args").integer("resolution", loaders::kStoredResolution, 1);
  if (coders.encoder.resolution != grid) {
    throw InputError(file, "/models/encoder/args/resolution",
                     "must be " + std::to_string(grid) + ", the grid of the dataset's voxels");
  }
  require_fitting_features(*data.train, coders, file);
  log::info("{} samples an epoch to train on, {} assets held out", data.train->size(),
            data.eval ? data.eval->size() : 0);

  models::Lpips lpips = nullptr;
  if (!options.lpips_weights.empty()) {
    lpips = models::load_lpips(options.lpips_weights);
    lpips->to(device);
  }
  auto stage =
      std::make_unique<StructuredLatentAutoEncoderStage>(coders, options, data.train, data.eval, device, lpips);
  if (stage->trains_geometry() && options.geometry.perceptual.lambda_lpips > 0.0 && lpips.is_empty()) {
    throw trainer_args.error("lambda_lpips",
                             "LPIPS needs its weights: name the files of VGG16 and of its heads in "
                             "trainer.args.lpips_weights, or set lambda_lpips to 0");
  }
  say_what_is_left_out(*stage, options);
  return stage;
}

}  // namespace anigen::train
