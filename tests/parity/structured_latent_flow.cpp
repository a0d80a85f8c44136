// The structured-latent flow: forward passes of every variant, the samplers with smoothed noise and joint counts, one
// training step's gradients, and the smoothing of noise alone.
#include "anigen/structured_latent/flow.h"

#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/flow/geodesic_noise.h"
#include "anigen/flow/matching.h"
#include "tests/parity/flow_cases.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using sparse::SparseTensor;
using structured_latent::StructuredLatentFlow;
using torch::Tensor;

StructuredLatentFlow loaded_slat_flow(Fixture& fixture, const Json& arguments, const std::string& pointer) {
  return loaded_flow<StructuredLatentFlow, structured_latent::StructuredLatentFlowOptions>(fixture, arguments, pointer);
}

SparseTensor voxels_with(const Fixture& fixture, const std::string& coords, const std::string& feats) {
  return {sparse::Support::create(fixture.input(coords)), fixture.input(feats)};
}

// The number in an output's description "joints_num=15 …".
std::int64_t described_count(const Fixture& fixture, const std::string& output) {
  const std::string key = "joints_num=", what = fixture.json().at("outputs").at(output).at("what");
  return std::stoll(what.substr(what.find(key) + key.size()));
}

void run_slat_flow(Fixture& fixture) {
  StructuredLatentFlow model = loaded_slat_flow(fixture, fixture.config(), "/config");
  const torch::NoGradGuard no_grad;
  const SparseTensor x = voxels_with(fixture, "coords", "feats"),
                     x_skl = voxels_with(fixture, "coords_skl", "feats_skl");
  const Tensor t = fixture.input("t"), cond = fixture.input("cond");
  const auto check = [&](const std::string& suffix, const Tensor& joints_num) {
    const auto velocity = model->forward(x, x_skl, t, cond, joints_num);
    fixture.check("v" + suffix, velocity.x.feats);
    fixture.check("v_skl" + suffix, velocity.x_skl.feats);
  };
  check("", fixture.has_input("joints_num") ? fixture.input("joints_num") : Tensor());
  // The fixture's outputs show which further calls it has.
  for (const std::string& output : fixture.outputs()) {
    if (output == "v_none") check("_none", {});
    if (output == "v_int") check("_int", torch::full({1}, described_count(fixture, output), torch::kInt64));
  }
}

// A number of joints of a sampling case: one for all, or one per item; undefined when the case says nothing.
Tensor joint_counts(const Json& arguments, const std::string& key) {
  if (!arguments.contains(key)) return {};
  const Json& value = arguments.at(key);
  return torch::tensor(value.is_array() ? value.get<std::vector<std::int64_t>>()
                                        : std::vector<std::int64_t>{value.get<std::int64_t>()});
}

void run_sampler_slat(Fixture& fixture) {
  StructuredLatentFlow model = loaded_slat_flow(fixture, fixture.config().at("model"), "/config/model");
  const SparseTensor x = voxels_with(fixture, "coords", "noise"),
                     x_skl = voxels_with(fixture, "coords_skl", "noise_skl");
  const Tensor cond = fixture.input("cond");
  const auto velocity_under = [&](const Tensor& tokens, const Tensor& joints_num) {
    return [=](const flow::Streams& state, float time) mutable {
      const Tensor t = torch::full({x.support->items().items()}, time, cond.device());
      const auto velocity = model->forward(x.with(state[0]), x_skl.with(state[1]), t, tokens, joints_num);
      return flow::Streams{velocity.x.feats, velocity.x_skl.feats};
    };
  };
  const std::int64_t first = model->options().geometry.in_channels, last = first + model->options().skin.in_channels;
  for (const auto& [name, arguments] : fixture.config().at("cases").items()) {
    const Tensor joints = joint_counts(arguments, "joints_num");
    // Only the sampler that guides at all times gives the other pass a number of its own.
    const bool has_own = arguments.at("sampler") != "interval" && arguments.contains("neg_joints_num");
    const Tensor neg_joints = has_own ? joint_counts(arguments, "neg_joints_num") : joints;
    flow::GeodesicNoiseOptions smoothing;
    if (arguments.contains("smooth")) {
      ConfigReader reader(arguments.at("smooth"), fixture.name() + ".json", "/config/cases/" + name + "/smooth");
      smoothing = flow::GeodesicNoiseOptions::read(reader);
      reader.finish();
    }
    const Tensor noise = flow::smooth_geodesic_noise(x.feats, x.support->coords(), first, last, smoothing);
    check_sampling_case(fixture, name, {noise, x_skl.feats}, velocity_under(cond, joints),
                        velocity_under(torch::zeros_like(cond), neg_joints));
  }
}

void run_train_slat_flow(Fixture& fixture) {
  StructuredLatentFlow model = loaded_slat_flow(fixture, fixture.config().at("model"), "/config/model");
  const double sigma_min = fixture.config().at("sigma_min");
  const Tensor t = fixture.input("t");
  const auto noisy_voxels = [&](const std::string& suffix) {
    const SparseTensor x_0 = voxels_with(fixture, "coords" + suffix, "x_0" + suffix);
    const Tensor times = t.index_select(0, x_0.support->items().item_of_rows(t.device()));
    return x_0.with(flow::noisy(x_0.feats, fixture.input("noise" + suffix), times, sigma_min));
  };
  const auto target = [&](const std::string& suffix) {
    return flow::velocity_target(fixture.input("x_0" + suffix), fixture.input("noise" + suffix), sigma_min);
  };
  const SparseTensor x_t = noisy_voxels(""), x_t_skl = noisy_voxels("_skl");
  const Tensor joints_num = fixture.has_input("joints_num") ? fixture.input("joints_num") : Tensor();
  const auto velocity = model->forward(x_t, x_t_skl, flow::model_time(t), fixture.input("cond"), joints_num);
  check_training_step(fixture, *model, {x_t.feats, target(""), velocity.x.feats},
                      {x_t_skl.feats, target("_skl"), velocity.x_skl.feats});
}

void run_geodesic_noise(Fixture& fixture) {
  const Json& config = fixture.config();
  flow::GeodesicNoiseOptions options;
  options.enabled = true;
  options.iterations = config.at("iters");
  options.alpha = config.at("alpha");
  const flow::FaceNeighbours neighbours = flow::face_neighbours(fixture.input("coords"));
  fixture.check("noise", flow::smooth_geodesic_noise(fixture.input("noise"), neighbours, config.at("start_ch"),
                                                     config.at("end_ch"), options));
  fixture.check("edges", torch::tensor(neighbours.row.size(0)));
  fixture.check("degree", neighbours.degree);
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(slat_flow, anigen::test::run_slat_flow)
ANIGEN_DEVICE_PARITY(sampler_slat, anigen::test::run_sampler_slat)
ANIGEN_DEVICE_PARITY(train_slat_flow, anigen::test::run_train_slat_flow)
ANIGEN_PARITY(ops_data_geodesic_noise, anigen::test::run_geodesic_noise)
