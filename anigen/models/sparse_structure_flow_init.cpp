#include "anigen/models/sparse_structure_flow_init.h"

#include "anigen/nn/init.h"

namespace anigen::models {
namespace {

void initialize_flow_stream(FlowStream& stream) {
  nn::normal_linear(*stream.t_embedder->first);
  nn::normal_linear(*stream.t_embedder->second);
  if (!stream.shared_modulation.is_empty()) nn::zero_parameters(*stream.shared_modulation);
  for (const nn::ModulatedCrossBlock& block : stream.blocks) {
    const nn::Linear modulation = block->modulation();
    if (!modulation.is_empty()) nn::zero_parameters(*modulation.ptr());
  }
  nn::zero_parameters(*stream.out_layer);
  for (const nn::Linear& adapter : stream.adapters) nn::zero_parameters(*adapter.ptr());
  for (const nn::Linear& output : stream.cross_outputs) nn::zero_parameters(*output.ptr());
}

}  // namespace

void initialize_flow(torch::nn::Module& model, FlowStream& shape, FlowStream& skeleton) {
  nn::xavier_uniform_linears(model);
  nn::default_norms(model);
  initialize_flow_stream(shape);
  initialize_flow_stream(skeleton);
}

}  // namespace anigen::models
