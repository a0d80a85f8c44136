#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/config_fields.h"

namespace anigen::sparse_structure {

/// Arguments that AniGenSparseStructureEncoder and -Decoder share (docs/reference/autoencoders.md, 3). Both classes
/// hold two convolutional streams: shape (no suffix) and skeleton (suffix `_skl`). Defaults are those of the class, not
/// of its config.
struct SparseStructureCoderOptions {
  std::int64_t latent_channels = 8, latent_channels_skl = 4;
  std::int64_t num_res_blocks = 2;         ///< r, per level
  std::int64_t num_res_blocks_middle = 2;  ///< m, at the coarsest level
  std::vector<std::int64_t> channels;      ///< width of each level, in the order they are passed through
  std::string norm_type = "layer";         ///< of the norm before the last convolution: "layer" or "group" (32 groups)
  bool use_fp16 = false;                   ///< blocks and middle_block in fp16
  bool encode_global = false, encode_global_skl = true;               ///< latents are tokens, see GlobalTokenEncoder
  std::int64_t global_token_num = 1024, global_token_num_skl = 1024;  ///< T
  bool use_pretrain_branch = true;     ///< training starts from a file of weights named after the class
  bool freeze_pretrain_branch = true;  ///< with use_pretrain_branch: modules_to_freeze are not trained
  std::vector<std::string> modules_to_freeze = {"blocks", "input_layer", "middle_block", "out_layer"};
  bool normalize_z = false, normalize_z_skl = true;  ///< latents of norm normalize_scale over the channels
  double normalize_scale = 1.0;                      ///< above 0
  std::string normalize_norm = "l2";                 ///< ours: of both streams, or "l1", as the paper's text has it

  std::int64_t levels() const { return static_cast<std::int64_t>(channels.size()); }
  /// Edge of the occupancy grid divided by the edge of the latent grid.
  std::int64_t downsampling() const { return std::int64_t{1} << (levels() - 1); }
  bool freezes() const { return use_pretrain_branch && freeze_pretrain_branch; }
  double norm_order() const { return normalize_norm == "l1" ? 1.0 : 2.0; }

 protected:
  void fields(ConfigFields& f);
  void validate_channels(const OptionCheck& check) const;
  /// @param coarsest width of the level the latents belong to
  void validate_coder(const OptionCheck& check, std::int64_t coarsest) const;
};

/// Arguments of AniGenSparseStructureEncoder; channels from fine to coarse.
struct SparseStructureEncoderOptions : SparseStructureCoderOptions, JsonOptions<SparseStructureEncoderOptions> {
  std::int64_t in_channels = 1, in_channels_skl = 1;
  /// The stream's latent is deterministic (and normalised, if the flag says so) instead of a Gaussian posterior.
  bool latent_denoising = false, latent_denoising_skl = true;

  void fields(ConfigFields& f);
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

/// Arguments of AniGenSparseStructureDecoder; channels from coarse to fine. normalize_z normalises what the decoder is
/// given, whatever the encoder did.
struct SparseStructureDecoderOptions : SparseStructureCoderOptions, JsonOptions<SparseStructureDecoderOptions> {
  std::int64_t out_channels = 1, out_channels_skl = 1;

  void fields(ConfigFields& f);
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

}  // namespace anigen::sparse_structure
