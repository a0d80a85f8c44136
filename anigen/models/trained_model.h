#pragma once
#include "anigen/io/torch_archive.h"
#include "anigen/models/run_model.h"
#include "anigen/models/state_dict.h"
#include "anigen/nn/init.h"

namespace anigen::models {

/// A trained model for use: weights loaded strictly, in fp32, evaluation mode, nothing asks for gradients.
/// @param found by find_run_model() @throws InputError when arguments or weights do not fit
template <typename Model, typename Options>
Model load_trained(const RunModel& found, torch::Device device) {
  Model model(Options::from_json(found.args, found.config.string(), found.pointer), nn::Init::kNone);
  load_state_dict(*model, io::read_state_dict(found.checkpoint), LoadMode::kStrict, found.checkpoint.string());
  for (const torch::Tensor& parameter : model->parameters()) torch::Tensor(parameter).requires_grad_(false);
  model->to(device);
  model->eval();
  return model;
}

}  // namespace anigen::models
