#include "anigen/models/sparse_structure_runs.h"

#include "anigen/io/torch_archive.h"
#include "anigen/models/state_dict.h"

namespace anigen::models {
namespace {

template <typename Model, typename Options>
Model load_trained(const RunModel& found, torch::Device device) {
  Model model(Options::from_json(found.args, found.config.string(), found.pointer), nn::Init::kNone);
  load_state_dict(*model, io::read_state_dict(found.checkpoint), LoadMode::kStrict, found.checkpoint.string());
  for (const torch::Tensor& parameter : model->parameters()) torch::Tensor(parameter).requires_grad_(false);
  model->to(device);
  model->eval();
  return model;
}

}  // namespace

SparseStructureEncoder load_sparse_structure_encoder(const RunModel& found, torch::Device device) {
  return load_trained<SparseStructureEncoder, SparseStructureEncoderOptions>(found, device);
}

SparseStructureDecoder load_sparse_structure_decoder(const RunModel& found, torch::Device device) {
  return load_trained<SparseStructureDecoder, SparseStructureDecoderOptions>(found, device);
}

}  // namespace anigen::models
