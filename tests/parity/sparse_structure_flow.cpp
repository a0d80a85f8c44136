// The sparse-structure flow: forward passes of every variant, the samplers, and one training step's gradients.
#include "anigen/sparse_structure/flow.h"

#include <string>

#include "anigen/flow/matching.h"
#include "tests/parity/flow_cases.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using sparse_structure::SparseStructureFlow;
using torch::Tensor;

SparseStructureFlow load_flow(Fixture& fixture, const Json& arguments, const std::string& pointer) {
  return loaded_flow<SparseStructureFlow, sparse_structure::SparseStructureFlowOptions>(fixture, arguments, pointer);
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
    const auto velocity = model->forward(x[0], x[1], torch::full({x[0].size(0)}, time, x[0].options()), cond);
    return flow::Streams{velocity.shape, velocity.skeleton};
  };
}

void run_sampler_ss(Fixture& fixture) {
  SparseStructureFlow model = load_flow(fixture, fixture.config().at("model"), "/config/model");
  const flow::Streams noise = {fixture.input("noise"), fixture.input("noise_skl")};
  const Tensor cond = fixture.input("cond");
  const flow::VelocityFunction conditional = velocity_under(model, cond);
  const flow::VelocityFunction unconditional = velocity_under(model, torch::zeros_like(cond));
  for (const auto& [name, arguments] : fixture.config().at("cases").items())
    check_sampling_case(fixture, name, noise, conditional, unconditional);
}

void run_train_ss_flow(Fixture& fixture) {
  SparseStructureFlow model = load_flow(fixture, fixture.config().at("model"), "/config/model");
  const double sigma_min = fixture.config().at("sigma_min");
  const Tensor t = fixture.input("t");
  const auto term = [&](const std::string& suffix) {
    const Tensor x_0 = fixture.input("x_0" + suffix), noise = fixture.input("noise" + suffix);
    return FlowMatchingTerm{flow::noisy(x_0, noise, t, sigma_min), flow::velocity_target(x_0, noise, sigma_min), {}};
  };
  FlowMatchingTerm shape = term(""), skeleton = term("_skl");
  const auto velocity = model->forward(shape.x_t, skeleton.x_t, flow::model_time(t), fixture.input("cond"));
  shape.velocity = velocity.shape;
  skeleton.velocity = velocity.skeleton;
  check_training_step(fixture, *model, shape, skeleton);
}

}  // namespace
}  // namespace anigen::test

ANIGEN_DEVICE_PARITY(ss_flow, anigen::test::run_ss_flow)
ANIGEN_DEVICE_PARITY(sampler_ss, anigen::test::run_sampler_ss)
ANIGEN_DEVICE_PARITY(train_ss_flow, anigen::test::run_train_ss_flow)
