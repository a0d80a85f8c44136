#include "tests/parity/flow_cases.h"

#include <set>
#include <utility>
#include <vector>

#include "anigen/nn/trainable.h"

namespace anigen::test {
namespace {

using torch::Tensor;

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

void check_gradients(Fixture& fixture, const torch::nn::Module& model) {
  const std::string prefix = "grad.";
  for (const nn::StateEntry& entry : nn::state_entries(model)) {
    for (const std::string& name : fixture.outputs()) {
      if (name == prefix + entry.key) fixture.check(name, entry.tensor.grad());
    }
  }
  if (!fixture.json().contains("frozen_params")) return;
  const std::vector<std::string> frozen = nn::frozen_parameters(model);
  const auto wanted = fixture.json().at("frozen_params").get<std::vector<std::string>>();
  fixture.check_true(
      "frozen: " + std::to_string(frozen.size()) + " parameters, expected " + std::to_string(wanted.size()),
      std::set<std::string>(frozen.begin(), frozen.end()) == std::set<std::string>(wanted.begin(), wanted.end()));
}

}  // namespace

flow::SamplerOptions sampler_options(const Fixture& fixture, const std::string& name) {
  Json arguments = fixture.config().at("cases").at(name);
  for (const char* other : {"sampler", "joints_num", "neg_joints_num", "smooth"}) arguments.erase(other);
  arguments["sigma_min"] = fixture.config().at("sigma_min");
  return flow::SamplerOptions::from_json(arguments, fixture.name() + ".json", "/config/cases/" + name);
}

void check_sampling_case(Fixture& fixture, const std::string& name, const flow::Streams& noise,
                         const flow::VelocityFunction& conditional, const flow::VelocityFunction& unconditional) {
  const std::string kind = fixture.config().at("cases").at(name).at("sampler");
  flow::SamplerOptions options = sampler_options(fixture, name);
  flow::Velocities velocities = {conditional};
  if (kind != "plain") velocities.unconditional = unconditional;
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
  check_sampled(fixture, name, options, flow::sample_flow(noise, velocities, options, extras));
}

void check_training_step(Fixture& fixture, const torch::nn::Module& model, const FlowMatchingTerm& term,
                         const FlowMatchingTerm& term_skl) {
  const Tensor mse = torch::mse_loss(term.velocity, term.target);
  const Tensor mse_skl = torch::mse_loss(term_skl.velocity, term_skl.target);
  const Tensor loss = mse + mse_skl;
  fixture.check("x_t", term.x_t);
  fixture.check("x_t_skl", term_skl.x_t);
  fixture.check("target", term.target);
  fixture.check("target_skl", term_skl.target);
  fixture.check("mse", mse);
  fixture.check("mse_skl", mse_skl);
  fixture.check("loss", loss);
  loss.backward();
  check_gradients(fixture, model);
}

}  // namespace anigen::test
