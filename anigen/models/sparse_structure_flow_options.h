#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/json.h"

namespace anigen::models {

/// Arguments of the published class AniGenSparseStructureFlowModel; defaults are those of the class (reference
/// flows-and-pipeline.md, 1.1). No suffix: the shape stream, called "ss"; `_skl`: the skeleton stream.
struct SparseStructureFlowOptions {
  std::int64_t resolution = 0;  ///< of the latent grid
  std::int64_t in_channels = 0, in_channels_skl = 0;
  std::int64_t out_channels = 0, out_channels_skl = 0;
  std::int64_t model_channels = 0, model_channels_skl = 0;
  std::int64_t cond_channels = 0;  ///< width of the condition tokens
  std::int64_t num_blocks = 0;
  std::int64_t num_heads = 0;  ///< of both streams; 0: model_channels / num_head_channels
  std::int64_t num_head_channels = 64;
  double mlp_ratio = 4.0;
  std::int64_t patch_size = 2;  ///< divides the resolution; streams of global tokens have no patches
  std::string pe_mode = "ape";  ///< the only one; "rope" cannot run in the published model either
  bool use_fp16 = false;        ///< the published precision of the torso, see half_precision_modules()
  bool use_checkpoint = false;  ///< keep no activations inside blocks; the backward pass forms them again
  bool share_mod = false;       ///< one modulation per stream instead of one per block
  bool qk_rms_norm = false, qk_rms_norm_cross = false;

  bool use_pretrain_branch = true;     ///< the shape stream starts from given weights
  bool freeze_pretrain_branch = true;  ///< and is not trained; LoRA also freezes it
  bool use_lora_ss = false;            ///< low-rank additions in the shape stream's attention
  double lora_lr_rate_ss = 0.1;        ///< their scale; not stored in a checkpoint
  std::vector<std::string> modules_to_freeze = {"blocks", "input_layer", "out_layer", "pos_emb", "t_embedder"};

  bool adapter_ss_to_skl = true, adapter_skl_to_ss = true;
  bool predict_x0 = false, predict_x0_skl = false;  ///< the network gives x₀, from which the velocity is formed
  double t_eps = 0.05, t_scale = 1000.0;            ///< of that division

  bool z_is_global = false, z_skl_is_global = false;  ///< a stream of tokens [B, n, C] that form no grid
  std::int64_t global_token_num = 1024, global_token_num_skl = 1024;
  std::int64_t cross_adapter_every = 4;  ///< with a global stream: exchange by cross attention every so many blocks
  bool skl_cross_from_ss = false;        ///< skeleton blocks attend to the shape stream instead of the condition

  /// @param file, pointer where the object stands, for messages
  /// @throws InputError on an unknown key (naming the nearest), a missing one, a wrong type or a value out of range;
  ///   NotSupportedError for pe_mode "rope"
  static SparseStructureFlowOptions from_json(const Json& json, const std::string& file = "",
                                              const std::string& pointer = "");
  Json to_json() const;
  void validate(const std::string& file = "", const std::string& pointer = "") const;

  std::int64_t heads() const { return num_heads > 0 ? num_heads : model_channels / num_head_channels; }
  std::int64_t tokens() const;      ///< of the shape stream
  std::int64_t tokens_skl() const;  ///< of the skeleton stream
  bool exchanges_by_attention() const { return z_is_global || z_skl_is_global; }
  bool freezes_shape_stream() const { return use_pretrain_branch && (freeze_pretrain_branch || use_lora_ss); }
  /// Whether the streams exchange by cross attention after this block: every cross_adapter_every-th, or the last one
  /// when there are fewer blocks than that.
  bool has_cross_adapter(std::int64_t block) const;
  /// Ranks of the low-rank additions to a block's self attention (the last third of the blocks, else 0) and to its
  /// cross attention (8, 16, 24, … by thirds); reference flows-and-pipeline.md, 1.8.
  std::int64_t lora_rank_self(std::int64_t block) const;
  std::int64_t lora_rank_cross(std::int64_t block) const;
};

}  // namespace anigen::models
