#pragma once
#include "anigen/io/ndarray.h"
#include "anigen/train/parameter_buffer.h"

namespace anigen::train {

/// State dict of a model with its trainable parameters taken from a flat fp32 vector (the masters, or an average),
/// frozen parameters as they were loaded, whatever type they compute in (ParameterBuffer::frozen), and buffers as they
/// are: what a checkpoint file holds (reference training-and-data.md, 2.8; the published trainer writes frozen
/// parameters in fp16).
io::NamedArrays weights_of(const nn::NamedModel& model, const ParameterBuffer& buffer, const torch::Tensor& flat);

/// Inverse: frozen entries into the model and what frozen() keeps of it, trainable ones into the flat vector at full
/// precision.
/// @param source file name for messages @throws InputError unless keys and shapes match exactly
void set_weights(const nn::NamedModel& model, const ParameterBuffer& buffer, torch::Tensor flat,
                 const io::NamedArrays& arrays, const std::string& source);

}  // namespace anigen::train
