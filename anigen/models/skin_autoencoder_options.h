#pragma once
#include <cstdint>
#include <string>

#include "anigen/core/json.h"

namespace anigen::models {

/// Arguments `jp_embedder_config` of the skin encoder (reference autoencoders.md, 1 and 1.1).
struct JointEmbedderOptions {
  std::int64_t hidden_dim = 0;  ///< H; 0 means jp_embed_dim
  std::int64_t depth = 4;       ///< D
  bool jp_embed_attn =
      true;                ///< blocks attend over the joints; false: each is an FFN that re-adds the embedder's input
  double mlp_ratio = 4.0;  ///< of the input layer and of the blocks
};

/// Arguments `encoder_config` (and `skin_encoder_config` of the structured-latent encoder).
struct SkinEncoderOptions {
  std::int64_t skin_feat_channels = 8;   ///< F
  std::int64_t skl_pos_embed_freq = 10;  ///< n, bands of the Fourier embedding
  std::int64_t jp_embed_dim = 128;       ///< E
  JointEmbedderOptions jp_embedder_config;
  bool relative_pe = true;          ///< embed joints relative to their parents
  bool vert_feat_is_linear = true;  ///< weights times embeddings; false: the head runs after the weighting
  bool normalize_feat = true;       ///< joint embeddings on the unit sphere

  static SkinEncoderOptions from_json(const Json& json, const std::string& file = "", const std::string& pointer = "");
  Json to_json() const;
  void validate(const std::string& file = "", const std::string& pointer = "") const;
  std::int64_t hidden_dim() const {
    return jp_embedder_config.hidden_dim > 0 ? jp_embedder_config.hidden_dim : jp_embed_dim;
  }
};

/// Arguments `decoder_config` (and `skin_decoder_config` of the structured-latent decoder).
struct SkinDecoderOptions {
  std::string model_type = "tree";      ///< the only one that exists
  std::int64_t skin_feat_channels = 8;  ///< F
  std::int64_t model_channels = 512;    ///< M
  std::int64_t num_blocks = 4;
  std::int64_t num_heads = 4;
  std::int64_t vert_cross_blocks_num = 0;  ///< the first so many vertex blocks cross-attend to the joints

  static SkinDecoderOptions from_json(const Json& json, const std::string& file = "", const std::string& pointer = "");
  Json to_json() const;
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

/// Arguments of the published class SkinAutoEncoder; defaults are those of the class, not of its config.
struct SkinAutoEncoderOptions {
  SkinEncoderOptions encoder_config;
  SkinDecoderOptions decoder_config;
  bool use_fp16 =
      false;  ///< the decoder's blocks in fp16; the joint embedder's blocks always are (see SkinAutoEncoder)

  /// @param file, pointer where the object stands, for messages
  /// @throws InputError on an unknown key (naming the nearest), a wrong type or a value out of range
  static SkinAutoEncoderOptions from_json(const Json& json, const std::string& file = "",
                                          const std::string& pointer = "");
  Json to_json() const;
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

}  // namespace anigen::models
