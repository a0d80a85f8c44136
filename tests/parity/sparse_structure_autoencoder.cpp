// The sparse-structure auto-encoder: both models in all variants, its losses with gradients, the noise on its latents.
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/voxel_metrics.h"
#include "anigen/train/stages/autoencoder_stage.h"
#include "tests/parity/described_part.h"
#include "tests/parity/parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

template <typename Model, typename Options>
Model filled_coder(Fixture& fixture) {
  Model model(Options::from_json(fixture.config(), fixture.name() + ".json", "/config"), nn::Init::kNone);
  // Position tables are computed here and stored there: compare before the stored ones take their place.
  const io::NamedArrays parameters = fixture.parameters();
  for (const nn::StateEntry& entry : nn::state_entries(*model)) {
    const io::NdArray* stored = io::find(parameters, entry.key);
    if (!entry.is_buffer || stored == nullptr) continue;
    fixture.check_true(entry.key + " equals the stored table",
                       torch::allclose(entry.tensor, nn::to_tensor(*stored), 1e-5, 1e-5));
  }
  load_whole(model, fixture);
  return model;
}

// A volume given as such, or by the indices [n, 5] of its ones.
Tensor occupancy_input(const Fixture& fixture, const std::string& dense, const std::string& sparse) {
  if (fixture.has_input(dense)) return fixture.input(dense);
  const Tensor shape = fixture.host_input("shape").to(torch::kInt64);
  std::vector<std::int64_t> sizes(shape.data_ptr<std::int64_t>(), shape.data_ptr<std::int64_t>() + shape.numel());
  Tensor volume = torch::zeros(sizes);
  const Tensor indices = fixture.host_input(sparse).to(torch::kInt64);
  Tensor flat = torch::zeros({indices.size(0)}, torch::kInt64);
  for (std::int64_t axis = 0; axis < 5; ++axis)
    flat = flat * sizes[static_cast<std::size_t>(axis)] + indices.select(1, axis);
  volume.view({-1}).index_fill_(0, flat, 1.0);
  return nn::to_device(volume, fixture.device());
}

void run_ss_encoder(Fixture& fixture) {
  auto model =
      filled_coder<sparse_structure::SparseStructureEncoder, sparse_structure::SparseStructureEncoderOptions>(fixture);
  sparse_structure::PosteriorNoise noise;
  if (fixture.has_input("eps")) noise.z = fixture.input("eps");
  if (fixture.has_input("eps_skl")) noise.z_skl = fixture.input("eps_skl");
  const bool sampled = noise.z.defined() || noise.z_skl.defined();
  const torch::NoGradGuard no_grad;
  const auto output = model->forward(occupancy_input(fixture, "x", "occ"), occupancy_input(fixture, "x_skl", "occ_skl"),
                                     sampled ? &noise : nullptr);
  fixture.check("z", output.z);
  fixture.check("mean", output.mean);
  fixture.check("logvar", output.logvar);
  fixture.check("z_skl", output.z_skl);
  fixture.check("mean_skl", output.mean_skl);
  fixture.check("logvar_skl", output.logvar_skl);
}

void run_ss_decoder(Fixture& fixture) {
  auto model =
      filled_coder<sparse_structure::SparseStructureDecoder, sparse_structure::SparseStructureDecoderOptions>(fixture);
  const torch::NoGradGuard no_grad;
  const auto logits = model->forward(fixture.input("x"), fixture.input("x_skl"));
  const Json& outputs = fixture.json().at("outputs");
  for (const std::string& name : fixture.outputs()) {
    const Tensor& volume = name.rfind("occ_skl", 0) == 0 ? logits.skeleton : logits.shape;
    if (name == "occ" || name == "occ_skl") {
      fixture.check(name, volume);
    } else if (name == "occ_sub" || name == "occ_skl_sub") {
      fixture.check(name, described_part(volume, outputs.at(name).at("what").get<std::string>()));
    } else if (name == "moments") {
      fixture.check(name, torch::stack({logits.shape.mean(), logits.shape.square().mean(), logits.skeleton.mean(),
                                        logits.skeleton.square().mean()}));
    }
  }
}

void run_ss_loss(Fixture& fixture) {
  const double lambda_kl = fixture.config().at("lambda_kl"), lambda_kl_skl = fixture.config().at("lambda_kl_skl");
  for (const std::string name : {"dice", "bce", "l1"}) {
    const sparse_structure::OccupancyLoss kind = sparse_structure::occupancy_loss_named(name);
    const Tensor logits = fixture.input("logits").requires_grad_(), mean = fixture.input("mean").requires_grad_(),
                 logvar = fixture.input("logvar").requires_grad_();
    const Tensor shape = sparse_structure::occupancy_loss(logits, fixture.input("ss"), kind);
    const Tensor skeleton =
        sparse_structure::occupancy_loss(fixture.input("logits_skl"), fixture.input("ss_skl"), kind);
    const Tensor kl = sparse_structure::posterior_kl(mean, logvar);
    const Tensor kl_skl = sparse_structure::posterior_kl(fixture.input("mean_skl"), fixture.input("logvar_skl"));
    const Tensor total = shape + skeleton + lambda_kl * kl + lambda_kl_skl * kl_skl;
    total.backward();
    fixture.check(name, shape);
    fixture.check(name + "_skl", skeleton);
    fixture.check("loss_" + name, total);
    fixture.check("grad_logits_" + name, logits.grad());
    fixture.check("grad_mean", mean.grad());
    fixture.check("grad_logvar", logvar.grad());
    fixture.check("kl", kl);
    fixture.check("kl_skl", kl_skl);
  }
}

train::LatentDenoising denoising_of(const Json& config, const std::string& suffix) {
  train::LatentDenoising noise;
  noise.gamma = config.at("latent_denoising_gamma" + suffix);
  noise.time_max = config.at("latent_time_max" + suffix);
  noise.ramp_steps = config.at("latent_achive_max_step" + suffix);
  return noise;
}

// Rows of a sparse latent: the times of their items, found by the batch index in the first column of coords.
Tensor row_times(const Fixture& fixture, const std::string& u, const std::string& coords, double time_max) {
  const Tensor times = train::latent_times(fixture.input(u), time_max, train::kSparseTimeCut);
  return times.index_select(0, fixture.input(coords).select(1, 0).to(torch::kInt64));
}

void run_latent_denoising(Fixture& fixture) {
  const Json& config = fixture.config();
  const train::LatentDenoising noise = denoising_of(config, ""), noise_skl = denoising_of(config, "_skl");
  const std::int64_t step = config.at("step");
  const double most = noise.time_max_at(step), most_skl = noise_skl.time_max_at(step);
  const Tensor times = train::latent_times(fixture.input("u"), most);
  fixture.check("time_max_now", torch::full({}, most, torch::kFloat64));
  fixture.check("time", times);
  fixture.check("z", train::mix_latent_noise(fixture.input("z"), fixture.input("noise"), times, noise.gamma));
  fixture.check("z_skl",
                train::mix_latent_noise(fixture.input("z_skl"), fixture.input("noise_skl"),
                                        train::latent_times(fixture.input("u_skl"), most_skl), noise_skl.gamma));

  const std::int64_t geometry = config.at("latent_channels");  // these channels get no noise
  const Tensor feats = fixture.input("s_feats");
  const Tensor skin = train::mix_latent_noise(feats.slice(1, geometry), fixture.input("s_noise"),
                                              row_times(fixture, "s_u", "coords", most), noise.gamma);
  fixture.check("s_feats", torch::cat({feats.slice(1, 0, geometry), skin}, 1));
  fixture.check("s_feats_skl",
                train::mix_latent_noise(fixture.input("s_feats_skl"), fixture.input("s_noise_skl"),
                                        row_times(fixture, "s_u_skl", "s_coords_skl", most_skl), noise_skl.gamma));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ss_encoder, anigen::test::run_ss_encoder)
ANIGEN_DEVICE_PARITY(ss_decoder, anigen::test::run_ss_decoder)
ANIGEN_DEVICE_PARITY(ops_loss_ss_vae, anigen::test::run_ss_loss)
ANIGEN_DEVICE_PARITY(ops_train_latent_denoising, anigen::test::run_latent_denoising)
