// The sparse-structure flow: forward passes of every variant, the samplers, and one training step's gradients.
#include "anigen/models/sparse_structure_flow.h"

#include <set>
#include <string>
#include <utility>
#include <vector>

#include "anigen/flow/euler_sampler.h"
#include "anigen/flow/flow_matching.h"
#include "anigen/models/state_dict.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using models::SparseStructureFlow;
using torch::Tensor;

SparseStructureFlow load_flow(Fixture& fixture, const Json& arguments, const std::string& pointer) {
  const auto options = models::SparseStructureFlowOptions::from_json(arguments, fixture.name() + ".json", pointer);
  SparseStructureFlow model(options, nn::Init::kNone);
  models::load_state_dict(*model, fixture.parameters(), models::LoadMode::kStrict, fixture.name() + ".safetensors");
  return model;
}

void run_ss_flow(Fixture& fixture) {
  SparseStructureFlow model = load_flow(fixture, fixture.config(), "/config");
  const torch::NoGradGuard no_grad;
  const auto velocity =
      model->forward(fixture.input("x"), fixture.input("x_skl"), fixture.input("t"), fixture.input("cond"));
  fixture.check("v", velocity.shape);
  fixture.check("v_skl", velocity.skeleton);
}

flow::VelocityFunction velocity_under(SparseStructureFlow model, const Tensor& cond) {
  return [model, cond](const flow::Streams& x, float time) mutable {
    const auto velocity = model->forward(x[0], x[1], torch::full({x[0].size(0)}, time), cond);
    return flow::Streams{velocity.shape, velocity.skeleton};
  };
}

flow::SamplerOptions sampler_options(const Fixture& fixture, const std::string& name) {
  Json arguments = fixture.config().at("cases").at(name);
  arguments.erase("sampler");
  arguments["sigma_min"] = fixture.config().at("sigma_min");
  return flow::SamplerOptions::from_json(arguments, fixture.name() + ".json", "/config/cases/" + name);
}

void check_sampled(Fixture& fixture, const std::string& name, const flow::SamplerOptions& options,
                   const flow::Sampled& result) {
  std::vector<float> times;
  for (const double t : flow::time_grid(options)) times.push_back(static_cast<float>(t));
  const std::vector<std::pair<std::string, Tensor>> found = {
      {"samples", result.samples[0]},      {"samples_skl", result.samples[1]}, {"x_t1", result.x_t.front()[0]},
      {"x_t1_skl", result.x_t.front()[1]}, {"x0_1", result.x_0.front()[0]},    {"x0_1_skl", result.x_0.front()[1]},
      {"t_seq", torch::tensor(times)}};
  for (const std::string& output : fixture.outputs()) {
    for (const auto& [key, tensor] : found) {
      if (output == name + "." + key) fixture.check(output, tensor);
    }
  }
}

void run_sampler_ss(Fixture& fixture) {
  SparseStructureFlow model = load_flow(fixture, fixture.config().at("model"), "/config/model");
  const flow::Streams noise = {fixture.input("noise"), fixture.input("noise_skl")};
  const Tensor cond = fixture.input("cond");
  for (const auto& [name, arguments] : fixture.config().at("cases").items()) {
    const std::string kind = arguments.at("sampler");
    flow::SamplerOptions options = sampler_options(fixture, name);
    flow::Velocities velocities = {velocity_under(model, cond)};
    if (kind != "plain") velocities.unconditional = velocity_under(model, torch::zeros_like(cond));
    if (kind == "interval" && !options.cfg_interval) options.cfg_interval = std::make_pair(0.0, 1.0);
    flow::SamplingExtras extras;
    extras.trajectory = true;
    flow::Inpainting known;
    if (kind == "cfg_inpaint") {
      known = {{fixture.input("known_x0"), fixture.input("known_x0_skl")},
               {fixture.input("known_noise"), fixture.input("known_noise_skl")},
               {fixture.input("inpaint_mask"), fixture.input("inpaint_mask_skl")}};
      extras.inpainting = &known;
    }
    check_sampled(fixture, name, options, flow::sample_euler(noise, velocities, options, extras));
  }
}

void run_train_ss_flow(Fixture& fixture) {
  SparseStructureFlow model = load_flow(fixture, fixture.config().at("model"), "/config/model");
  const double sigma_min = fixture.config().at("sigma_min");
  const Tensor t = fixture.input("t"), x_0 = fixture.input("x_0"), x_0_skl = fixture.input("x_0_skl");
  const Tensor noise = fixture.input("noise"), noise_skl = fixture.input("noise_skl");
  const Tensor x_t = flow::noisy(x_0, noise, t, sigma_min), x_t_skl = flow::noisy(x_0_skl, noise_skl, t, sigma_min);
  const Tensor target = flow::velocity_target(x_0, noise, sigma_min);
  const Tensor target_skl = flow::velocity_target(x_0_skl, noise_skl, sigma_min);
  const auto velocity = model->forward(x_t, x_t_skl, flow::model_time(t), fixture.input("cond"));
  const Tensor mse = torch::mse_loss(velocity.shape, target), mse_skl = torch::mse_loss(velocity.skeleton, target_skl);
  fixture.check("x_t", x_t);
  fixture.check("x_t_skl", x_t_skl);
  fixture.check("target", target);
  fixture.check("target_skl", target_skl);
  fixture.check("mse", mse);
  fixture.check("mse_skl", mse_skl);
  fixture.check("loss", mse + mse_skl);
  (mse + mse_skl).backward();

  std::vector<std::string> frozen;
  const std::string prefix = "grad.";
  for (const models::StateEntry& entry : models::state_entries(*model)) {
    if (!entry.is_buffer && !entry.tensor.requires_grad()) frozen.push_back(entry.key);
    for (const std::string& name : fixture.outputs()) {
      if (name == prefix + entry.key) fixture.check(name, entry.tensor.grad());
    }
  }
  if (fixture.json().contains("frozen_params")) {
    const auto wanted = fixture.json().at("frozen_params").get<std::vector<std::string>>();
    fixture.check_true(
        "frozen: " + std::to_string(frozen.size()) + " parameters, expected " + std::to_string(wanted.size()),
        std::set<std::string>(frozen.begin(), frozen.end()) == std::set<std::string>(wanted.begin(), wanted.end()));
  }
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ss_flow, anigen::test::run_ss_flow)
ANIGEN_PARITY(sampler_ss, anigen::test::run_sampler_ss)
ANIGEN_PARITY(train_ss_flow, anigen::test::run_train_ss_flow)
