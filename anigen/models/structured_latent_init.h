#pragma once
#include "anigen/nn/linear.h"

namespace anigen::models {

/// The published start of everything below `module` (reference autoencoders.md, 3.10): Xavier-uniform linears with zero
/// biases, norms 1 and 0, sparse convolutions as the library's, the last one of each up-sampling block zero.
void initialize_sparse_layers(torch::nn::Module& module);

/// An output layer of the decoder: Kaiming-normal weights (fan-in, gain √2) times 1e-4, zero bias.
void initialize_field_head(nn::LinearImpl& head);

}  // namespace anigen::models
