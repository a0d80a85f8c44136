#include "anigen/models/structured_latent_flow_init.h"

#include "anigen/nn/init.h"
#include "anigen/sparse/convolution.h"

namespace anigen::models {
namespace {

void initialize_slat_flow_stream(StructuredLatentFlowStream& stream) {
  nn::normal_linear(*stream.t_embedder->first);
  nn::normal_linear(*stream.t_embedder->second);
  if (!stream.shared_modulation.is_empty()) nn::zero_parameters(*stream.shared_modulation);
  if (stream.joint_unconditional.defined()) torch::nn::init::zeros_(stream.joint_unconditional);
  for (auto* blocks : {&stream.input_blocks, &stream.out_blocks}) {
    for (sparse::ResidualBlock& block : *blocks) block->initialize();
  }
  for (const sparse::SparseModulatedCrossBlock& block : stream.blocks) {
    const nn::Linear modulation = block->modulation();
    if (!modulation.is_empty()) nn::zero_parameters(*modulation.ptr());
  }
  nn::zero_parameters(*stream.out_layer);
}

}  // namespace

void initialize_flow(torch::nn::Module& model, const std::vector<StructuredLatentFlowStream*>& streams,
                     const std::vector<nn::Linear>& adapters) {
  nn::xavier_uniform_linears(model);
  nn::default_norms(model);
  sparse::default_submanifold_kernels(model);
  for (StructuredLatentFlowStream* stream : streams) initialize_slat_flow_stream(*stream);
  for (const nn::Linear& adapter : adapters) nn::zero_parameters(*adapter.ptr());
}

}  // namespace anigen::models
