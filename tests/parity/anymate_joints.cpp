// Anymate's joint prediction: regression, diffusion, and fields over voxels.
#include "anigen/anymate/denoisers.h"
#include "anigen/anymate/joints.h"
#include "anigen/anymate/volumes.h"
#include "tests/parity/anymate_parts.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

void run_dbscan(Fixture& fixture) {
  const Tensor points = fixture.input("points");
  for (const Json& set : fixture.config().at("sets")) {
    const anymate::DbscanOptions options = {set.at("eps"), set.at("min_samples")};
    const std::vector<std::int64_t> labels = anymate::dbscan_labels(points, options);
    const std::string name = set.at("name");
    fixture.check("labels_" + name, torch::tensor(labels, torch::kInt64));
    fixture.check("centers_" + name, anymate::cluster_means(points, labels));
  }
}

void run_joint_transformer(Fixture& fixture) {
  anymate::JointRegression model(anymate_head(fixture), anymate_size(fixture, "num_latents"), 3, nn::Init::kNone);
  load_all(model, fixture);
  const Tensor latents = input_with_gradient(fixture, "latents"), predicted = model(latents);
  const Tensor loss =
      anymate::joint_chamfer_loss(predicted, fixture.input("joints"), anymate_counts(fixture, "joints_num"));
  loss.backward();
  fixture.check("pred", predicted);
  fixture.check("loss", loss);
  fixture.check("grad_query", model->named_parameters()["query"].grad());
  fixture.check("grad_latents", latents.grad());
  const anymate::DbscanOptions options = {fixture.config().at("eps"), fixture.config().at("min_samples")};
  fixture.check("clusters", anymate::merged_joints(predicted[0], options));
}

void run_ddim(Fixture& fixture) {
  const std::int64_t steps = anymate_size(fixture, "num_inference_steps");
  const anymate::DdimSchedule schedule(anymate_size(fixture, "num_train_timesteps"));
  fixture.check("alphas_cumprod", schedule.alphas_cumprod());
  fixture.check("noisy", schedule.noisy(fixture.input("x0"), fixture.input("noise"), fixture.input("t")));
  const std::vector<std::int64_t> times = schedule.timesteps(steps);
  fixture.check("timesteps", torch::tensor(times, torch::kInt64));
  const Tensor predicted = fixture.input("eps_pred");
  anymate::DdimSchedule::Step step = {fixture.input("start"), {}};
  std::vector<Tensor> chain;
  for (std::size_t i = 0; i < times.size(); ++i) {
    step =
        schedule.step(step.previous, predicted[static_cast<std::int64_t>(i)], times[i], schedule.train_steps() / steps);
    chain.push_back(step.previous);
  }
  fixture.check("chain", torch::stack(chain));
  fixture.check("pred_x0_last", step.x_0);
}

// The training loss with its gradient, and a call as at inference.
void check_denoiser(Fixture& fixture, anymate::JointDenoiserImpl& model) {
  const anymate::DdimSchedule schedule;
  const Tensor latents = input_with_gradient(fixture, "latent");
  const anymate::DenoisingTerm term = anymate::denoising_term(model, schedule, fixture.input("samples"), latents,
                                                              fixture.input("noise"), fixture.input("t"));
  term.loss.backward();
  fixture.check("noisy", term.noisy);
  fixture.check("pred", term.predicted);
  fixture.check("loss", term.loss);
  fixture.check("grad_latent", latents.grad());
  const torch::NoGradGuard no_grad;
  fixture.check("pred_infer",
                model.forward(term.noisy.narrow(0, 0, 1), fixture.input("t1"), latents.detach().narrow(0, 0, 1)));
}

void run_diffusion_concat(Fixture& fixture) {
  anymate::ConcatDenoiserOptions options;
  options.width = anymate_size(fixture, "width");
  options.layers = anymate_size(fixture, "layers");
  options.heads = anymate_size(fixture, "heads");
  anymate::ConcatDenoiser model(options, nn::Init::kNone);
  load_all(model, fixture);
  check_denoiser(fixture, *model);
}

void run_diffusion_cross(Fixture& fixture) {
  anymate::CrossDenoiserOptions options;
  options.num_z = anymate_size(fixture, "num_z");
  options.num_latents = anymate_size(fixture, "num_latents");
  options.z_dim = anymate_size(fixture, "z_dim");
  options.x_dim = anymate_size(fixture, "x_dim");
  options.num_blocks = anymate_size(fixture, "num_blocks");
  options.num_compute_layers = anymate_size(fixture, "num_compute_layers");
  options.num_heads = anymate_size(fixture, "num_heads");
  options.mlp_ratio = fixture.config().at("mlp_ratio");
  options.qkv_bias = fixture.config().at("qkv_bias");
  options.use_projection = fixture.config().at("use_projection");
  anymate::CrossDenoiser model(options, nn::Init::kNone);
  load_all(model, fixture);
  check_denoiser(fixture, *model);
}

// Rows in ascending order of x, then y, then z.
Tensor sorted_points(Tensor points) {
  for (const std::int64_t axis : {2, 1, 0})
    points = points.index_select(0, std::get<1>(points.select(1, axis).sort(/*stable=*/true, 0, false)));
  return points;
}

void run_implicit(Fixture& fixture) {
  anymate::ImplicitVolume model(anymate_head(fixture), nn::Init::kNone);
  load_all(model, fixture);
  const Tensor latents = input_with_gradient(fixture, "latents"), joints = fixture.input("joints");
  const std::vector<std::int64_t> counts = anymate_counts(fixture, "joints_num");
  std::vector<Tensor> voxels, truths;
  for (std::int64_t b = 0; b < latents.size(0); ++b) {
    const std::string item = std::to_string(b);
    voxels.push_back(fixture.input("vox" + item));
    truths.push_back(joints[b].narrow(0, 0, counts.at(static_cast<std::size_t>(b))));
    const Tensor corners = anymate::voxel_corners(voxels.back());
    fixture.check("co" + item, corners);
    fixture.check("gt" + item, anymate::joint_heat(corners, truths.back()));
    // In chunks, which must not show.
    const Tensor one = latents.detach().narrow(0, b, 1);
    fixture.check("logits" + item, anymate::joint_volume(*model, one, voxels.back(), 7));
  }
  const Tensor loss = anymate::joint_volume_loss(*model, latents, voxels, truths);
  loss.backward();
  fixture.check("loss", loss);
  fixture.check("grad_latents", latents.grad());
  fixture.check("keypoints",
                sorted_points(anymate::joint_key_points(fixture.input("heat"), fixture.input("heat_vox"))));
}

void run_triplane(Fixture& fixture) {
  const torch::NoGradGuard no_grad;
  anymate::StyleGeneratorOptions options;
  options.z_dim = anymate_size(fixture, "z_dim");
  options.w_dim = anymate_size(fixture, "w_dim");
  options.img_resolution = anymate_size(fixture, "img_resolution");
  options.channel_base = anymate_size(fixture, "channel_base");
  options.channel_max = anymate_size(fixture, "channel_max");
  options.mapping_layers = anymate_size(fixture, "mapping_layers");
  anymate::TriplaneVolume model(options, nn::Init::kNone);
  load_all(model, fixture);
  const Tensor z = fixture.input("z");
  fixture.check("ws", model->styles(z));
  fixture.check("planes", model->planes(z));
  for (std::int64_t b = 0; b < z.size(0); ++b) {
    const std::string item = std::to_string(b);
    fixture.check("logits" + item,
                  anymate::joint_volume(*model, z.narrow(0, b, 1), fixture.input("vox" + item), /*chunk=*/6));
  }
  fixture.check("plane_axes", anymate::triplane_axes());
  const Tensor sampled = anymate::sample_planes(fixture.input("plane_feats"), fixture.input("queries"));
  fixture.check("sampled", sampled);
  fixture.check("decoded", model->decoded(sampled));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_anymate_dbscan, anigen::test::run_dbscan)
ANIGEN_DEVICE_PARITY(ops_anymate_joint_transformer, anigen::test::run_joint_transformer)
ANIGEN_PARITY(ops_anymate_ddim, anigen::test::run_ddim)
ANIGEN_DEVICE_PARITY(ops_anymate_diffusion_concat, anigen::test::run_diffusion_concat)
ANIGEN_DEVICE_PARITY(ops_anymate_diffusion_cross, anigen::test::run_diffusion_cross)
ANIGEN_DEVICE_PARITY(ops_anymate_implicit, anigen::test::run_implicit)
ANIGEN_DEVICE_PARITY(ops_anymate_triplane, anigen::test::run_triplane)
