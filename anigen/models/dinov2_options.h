#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/json.h"

namespace anigen::models {

/// Size and form of a DINOv2 vision transformer (Oquab et al. 2023; registers: Darcet et al. 2023), under the argument
/// names of the published hub models (reference flows-and-pipeline.md, 5.3).
struct Dinov2Options {
  std::int64_t img_size = 518;   ///< pixels on a side for which pos_embed was made
  std::int64_t patch_size = 14;  ///< pixels
  std::int64_t embed_dim = 1024;
  std::int64_t depth = 24;
  std::int64_t num_heads = 16;
  double mlp_ratio = 4.0;
  /// "mlp": Linear · exact GELU · Linear. "swiglufused" (also spelt "swiglu"): silu(a) ⊙ b, then Linear, with the
  /// hidden width reduced to two thirds, rounded up to a multiple of 8.
  std::string ffn_layer = "mlp";
  std::int64_t num_register_tokens = 0;
  /// How pos_embed is brought to another number of patches: see interpolate_positions.
  bool interpolate_antialias = false;
  double interpolate_offset = 0.1;

  /// The published models by name: dinov2_vits14, dinov2_vitb14, dinov2_vitl14, dinov2_vitg14 and the same with _reg.
  /// @throws InputError naming the nearest one
  static Dinov2Options named(const std::string& name);
  static std::vector<std::string> names();
  /// What the published file of a model is called, without its extension: dinov2_vitl14_reg comes as
  /// dinov2_vitl14_reg4_pretrain.pth.
  static std::string published_file_stem(const std::string& name);

  /// Also reads `init_values` (of no use once weights are loaded) and `block_chunks` (0 only, the form of the published
  /// weights). @param file, pointer where the object stands, for messages
  /// @throws InputError on an unknown key, a wrong type or a value out of range; NotSupportedError for block_chunks
  static Dinov2Options from_json(const Json& json, const std::string& file = "", const std::string& pointer = "");
  Json to_json() const;
  void validate(const std::string& file = "", const std::string& pointer = "") const;

  std::int64_t patches_per_side() const { return img_size / patch_size; }  ///< of pos_embed
  std::int64_t ffn_hidden() const;                                         ///< width between the two linear maps
  bool swiglu() const { return ffn_layer != "mlp"; }
};

}  // namespace anigen::models
