#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/json.h"

namespace anigen {
class ConfigReader;
}

namespace anigen::models {

/// Sizes of one stream of the structured-latent flow.
struct StructuredLatentFlowStreamOptions {
  std::int64_t in_channels = 0, out_channels = 0;
  std::int64_t model_channels = 0;
  std::int64_t num_heads = 0;  ///< 0 (null in JSON): model_channels / num_head_channels
  std::int64_t num_head_channels = 64;
  std::int64_t num_io_res_blocks = 2;  ///< residual blocks before each change of resolution, that one included
  /// Width of the residual blocks at each resolution finer than the transformer's, finest first; unset (null): no
  /// residual blocks, the transformer sees the voxels themselves.
  std::optional<std::vector<std::int64_t>> io_block_channels;

  std::int64_t heads() const { return num_heads > 0 ? num_heads : model_channels / num_head_channels; }
  /// How often the residual blocks halve the resolution.
  std::int64_t levels() const { return io_block_channels ? static_cast<std::int64_t>(io_block_channels->size()) : 0; }
};

/// Arguments of the published classes AniGenElasticSLatFlowModel and AniGenSLatFlowModel, which compute the same;
/// defaults are those of the class (reference flows-and-pipeline.md, 2.1). In JSON the sizes of a stream carry its
/// suffix: none for the geometry, `_vert_skin` for the skin, `_skl` for the skeleton.
struct StructuredLatentFlowOptions {
  std::int64_t resolution = 0;  ///< of the voxels; a bound on coordinates, no weight depends on it
  StructuredLatentFlowStreamOptions geometry, skin, skeleton;
  std::int64_t cond_channels = 0;  ///< width of the condition tokens
  std::int64_t num_blocks = 0;
  double mlp_ratio = 4.0;
  /// 2 to the number of io_block_channels of each stream that has them, else without a meaning. The published model
  /// cannot run with more than 2.
  std::int64_t patch_size = 2;
  std::string pe_mode = "ape";      ///< the only one; "rope" cannot run in the published model either
  bool use_fp16 = false;            ///< the published precision of the torso, see half_precision_modules()
  bool use_checkpoint = false;      ///< keep no activations inside blocks; the backward pass forms them again
  bool use_skip_connection = true;  ///< output blocks also see what the input blocks of the same resolution gave
  bool share_mod = false;           ///< one modulation per stream instead of one per block
  bool qk_rms_norm = false, qk_rms_norm_cross = false;

  bool use_pretrain_branch = true;     ///< the geometry stream starts from given weights
  bool freeze_pretrain_branch = true;  ///< and is not trained
  std::vector<std::string> modules_to_freeze = {"blocks",     "input_blocks", "input_layer",
                                                "out_blocks", "out_layer",    "t_embedder"};

  bool predict_x0 = false;                ///< skin and skeleton: the network gives what a velocity is formed from
  double t_eps = 0.05, t_scale = 1000.0;  ///< of that division

  bool use_joint_num_cond = false;  ///< skin and skeleton are conditioned on how many joints there shall be
  std::int64_t joint_num_max = 60;  ///< more joints count as this many
  std::int64_t joint_num_fourier_bands = 6;

  /// Asks the reader for every argument of the class; the caller calls reader.finish() where nothing else is to be
  /// read. @throws InputError on a wrong type or a value out of range; NotSupportedError for pe_mode "rope"
  static StructuredLatentFlowOptions read(ConfigReader& reader);
  /// @param file, pointer where the object stands, for messages @throws as read(); InputError on an unknown key, naming
  /// the nearest
  static StructuredLatentFlowOptions from_json(const Json& json, const std::string& file = "",
                                               const std::string& pointer = "");
  Json to_json() const;
  void validate(const std::string& file = "", const std::string& pointer = "") const;

  bool freezes_geometry() const { return use_pretrain_branch && freeze_pretrain_branch; }
};

}  // namespace anigen::models
