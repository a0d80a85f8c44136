#pragma once
#include <cstdint>
#include <filesystem>
#include <string>

#include "anigen/anymate/model.h"
#include "anigen/core/config_fields.h"

namespace anigen::train {

/// Fills the encoder of an Anymate model with the weights that the released trainings begin from
/// (docs/reference/anymate.md, 2.2 and 2.3): for Point-BERT the `model.point_backbone.*` of PointLLM, for Michelangelo
/// the `model.shape_model.*` and `model.shape_projection` of "shapevae-256". Nothing else of the file is read. Where
/// Michelangelo's `input_proj` has 54 columns, those are filled and the 25 of the normal's harmonics stay as they are.
/// @param path the file, `.bin`, `.ckpt`, `.pt`, `.pth` or `.safetensors`, or a folder with the parts of a large model,
/// model*.safetensors or else pytorch_model*.bin
/// @throws InputError for a path without such weights, when one of the encoder's tensors is in none of them, and for
/// shapes; the model is then untouched. NotSupportedError for the scratch encoder, which has no pretrained weights
void load_pretrained_encoder(anymate::AnymateModelImpl& model, const std::filesystem::path& path);

/// Arguments of AnymateTrainer beside those all trainers share; released values are the defaults
/// (docs/reference/anymate.md, 3, 4, 5 and 7).
struct AnymateStageOptions : JsonOptions<AnymateStageOptions> {
  std::int64_t num_train_step = 100;       ///< levels of noise of a denoiser
  std::int64_t num_training_points = 128;  ///< joints that it denoises
  std::int64_t skin_points = 1024;         ///< of the sampled points, in a step of skinning
  std::int64_t field_cells = 50000;        ///< of the cells inside, in a step of a field
  std::int64_t eval_max_assets = 0;        ///< held-out assets to look at; 0: all
  std::string connectivity_loss = "ce";    ///< ours: or "bce" (connectivity_bce)
  std::string pretrained_encoder;          ///< ours: load_pretrained_encoder()'s path; empty: from random weights

  void fields(ConfigFields& f);
};

}  // namespace anigen::train
