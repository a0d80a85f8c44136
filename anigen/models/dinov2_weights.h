#pragma once
#include <filesystem>

#include "anigen/models/dinov2.h"

namespace anigen::models {

/// Fills a model from a file of published weights: `.pth` / `.pt` of torch.save, or `.safetensors`, with the hub's keys
/// or those of the `transformers` library (models/dinov2_keys.h). Afterwards no parameter asks for gradients and the
/// model is in evaluation mode.
/// @throws InputError naming the file and, where it applies, the key: a damaged file, missing or unexpected keys,
///   another size of model (both shapes), a value that is not finite, whole numbers where floats belong
void load_dinov2_weights(Dinov2& model, const std::filesystem::path& file);

}  // namespace anigen::models
