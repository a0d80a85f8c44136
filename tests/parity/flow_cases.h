#pragma once
#include <string>

#include "anigen/flow/sampler.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "tests/parity/fixture.h"
#include "tests/parity/parts.h"

// Cases that the fixtures of the two flows share: sampling runs described by `config.cases`, and training steps.
namespace anigen::test {

/// The sampler options of a case; keys about the model and the kind of sampler are left out.
flow::SamplerOptions sampler_options(const Fixture& fixture, const std::string& name);

/// One sampling run as the case says: unguided, guided or guided in an interval, with the known part of the fixture
/// for `cfg_inpaint`. Checks every output of the case.
/// @param conditional, unconditional the model in the two passes
void check_sampling_case(Fixture& fixture, const std::string& name, const flow::Streams& noise,
                         const flow::VelocityFunction& conditional, const flow::VelocityFunction& unconditional);

/// One of the two terms of a training step's loss.
struct FlowMatchingTerm {
  torch::Tensor x_t, target, velocity;
};

/// Checks noisy states, targets, the loss and, after its backward pass, the gradients `grad.<key>`; and which
/// parameters are frozen where the fixture lists them.
void check_training_step(Fixture& fixture, const torch::nn::Module& model, const FlowMatchingTerm& term,
                         const FlowMatchingTerm& term_skl);

/// A model with the parameters of the fixture. @param arguments of its class, which stand at `pointer` of the fixture
template <typename Model, typename Options>
Model loaded_flow(Fixture& fixture, const Json& arguments, const std::string& pointer) {
  Model model(Options::from_json(arguments, fixture.name() + ".json", pointer), nn::Init::kNone);
  load_whole(model, fixture);
  return model;
}

}  // namespace anigen::test
