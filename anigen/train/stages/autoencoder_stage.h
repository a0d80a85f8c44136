#pragma once
#include <algorithm>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/nn/init.h"
#include "anigen/train/stage.h"
#include "anigen/train/stages/stages.h"
#include "anigen/train/warm_start.h"

namespace anigen::train {

/// Noise that an auto-encoder's trainer mixes into a latent before it is decoded, so that the decoder learns to clean
/// it (paper 3.3; docs/reference/training.md, 3.2).
struct LatentDenoising {
  bool enabled = false;
  double gamma = 1.0;           ///< size of the noise
  double time_max = 0.5;        ///< largest share of noise
  std::int64_t ramp_steps = 0;  ///< steps over which time_max is reached; 0: at once

  /// `latent_denoising`, `latent_denoising_gamma`, `latent_time_max` and `latent_achive_max_step` (spelled so in
  /// published configs), each with `suffix` ("", "_skl") appended.
  void fields(ConfigFields& f, const std::string& suffix);

  /// Largest share of noise at a step: min(1, step / ramp_steps) · time_max.
  double time_max_at(std::int64_t step) const;
};

/// Lower bound of 1 − u; the published trainers differ.
inline constexpr double kDenseTimeCut = 1e-8, kSparseTimeCut = 1e-10;

/// Shares of noise (1 − √max(1 − u, cut)) · time_max, whose density falls linearly to 0 at time_max.
/// @param u uniform in [0, 1), one per item @return the shape of u
torch::Tensor latent_times(const torch::Tensor& u, double time_max, double cut = kDenseTimeCut);

/// (1 − t) z + t γ noise. @param z [N, …] @param noise the same shape @param times [N], one per row of z: for a sparse
/// latent those of its items gathered by batch index
torch::Tensor mix_latent_noise(const torch::Tensor& z, const torch::Tensor& noise, const torch::Tensor& times,
                               double gamma);

/// Standard normal fp32 numbers of a CPU generator, on the device.
torch::Tensor normal_draws(torch::IntArrayRef shape, const at::Generator& generator, torch::Device device);

/// Base of the stages of both auto-encoders, models `encoder` and `decoder`.
/// @tparam Encoder, Decoder holders of nn::StreamCoder modules with a constructor (options, init)
/// @tparam Coders {encoder, decoder}: the options of both @tparam Options with eval_max_assets and warm_start
template <typename Encoder, typename Decoder, typename Coders, typename Options>
class AutoEncoderStage : public Stage {
 public:
  using Dataset = std::shared_ptr<const data::BatchSource>;

  /// @param held_out may be null: evaluate() and sample() then do nothing
  AutoEncoderStage(const Coders& coders, const Options& options, Dataset data, Dataset held_out, torch::Device device,
                   nn::Init init = nn::Init::kPublished)
      : coders_(coders),
        options_(options),
        data_(std::move(data)),
        held_out_(std::move(held_out)),
        device_(device),
        encoder_(coders.encoder, init),
        decoder_(coders.decoder, init) {
    encoder_->to(device_);
    decoder_->to(device_);
  }

  std::vector<nn::NamedModel> models() const override {
    return {{"encoder", encoder_.ptr()}, {"decoder", decoder_.ptr()}};
  }
  const data::BatchSource& data() const override { return *data_; }
  void set_data(Dataset data) override { data_ = std::move(data); }
  bool supports(torch::Dtype dtype) const override {
    return dtype == torch::kHalf ? device_.is_cuda() : dtype != torch::kFloat64;
  }
  void set_compute_dtype(torch::Dtype dtype) override {
    encoder_->set_torso_dtype(dtype);
    decoder_->set_torso_dtype(dtype);
  }

  Encoder& encoder() { return encoder_; }
  Decoder& decoder() { return decoder_; }

 protected:
  /// Makes a replica see the frozen weights of this stage.
  std::unique_ptr<Stage> with_frozen_weights(std::unique_ptr<AutoEncoderStage> replica) const {
    share_frozen_weights(*encoder_, *replica->encoder_);
    share_frozen_weights(*decoder_, *replica->decoder_);
    return replica;
  }

  Coders coders_;
  Options options_;
  Dataset data_, held_out_;
  torch::Device device_;
  Encoder encoder_;
  Decoder decoder_;
};

/// Both models of an auto-encoder, which fit each other. @throws InputError
template <typename Coders>
Coders read_coders(ConfigReader& top, const char* encoder_class, const char* decoder_class) {
  ConfigReader models = top.object("models");
  Coders coders;
  coders.encoder = read_model<decltype(coders.encoder)>(models, "encoder", {encoder_class});
  coders.decoder = read_model<decltype(coders.decoder)>(models, "decoder", {decoder_class});
  models.finish();
  coders.validate(models.file());
  return coders;
}

/// The dataset of an auto-encoder's config, which must be of this class. @throws InputError
data::Datasets autoencoder_datasets(ConfigReader& top, const char* class_name, std::uint64_t seed);

}  // namespace anigen::train
