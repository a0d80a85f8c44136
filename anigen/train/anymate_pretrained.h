#pragma once
#include <filesystem>

#include "anigen/models/anymate/model.h"

namespace anigen::train {

/// Fills the encoder of an Anymate model with the weights that the released trainings begin from (reference
/// anymate-baselines.md, 2.2 and 2.3): for Point-BERT the `model.point_backbone.*` of PointLLM, for Michelangelo the
/// `model.shape_model.*` and `model.shape_projection` of "shapevae-256". Nothing else of the file is read. Where
/// Michelangelo's `input_proj` has 54 columns, those are filled and the 25 of the normal's harmonics stay as they are.
/// @param path the file, `.bin`, `.ckpt`, `.pt`, `.pth` or `.safetensors`, or a folder with the parts of a large model,
/// model*.safetensors or else pytorch_model*.bin
/// @throws InputError for a path without such weights, when one of the encoder's tensors is in none of them, and for
/// shapes; the model is then untouched. NotSupportedError for the scratch encoder, which has no pretrained weights
void load_pretrained_encoder(models::anymate::AnymateModelImpl& model, const std::filesystem::path& path);

}  // namespace anigen::train
