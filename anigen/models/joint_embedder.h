#pragma once
#include <vector>

#include "anigen/models/skin_autoencoder_options.h"
#include "anigen/nn/feed_forward.h"
#include "anigen/nn/ragged.h"
#include "anigen/nn/transformer_block.h"

namespace anigen::models {

inline constexpr std::int64_t kJointEmbedderHeads = 8;  ///< fixed, whatever the hidden width

/// Turns the embedded pair (joint, parent) of each joint into its embedding, by attention over the joints of its asset
/// or, with jp_embed_attn off, joint by joint (reference autoencoders.md, 1.1, steps 5 to 7).
class JointEmbedderImpl : public torch::nn::Module {
 public:
  JointEmbedderImpl(std::int64_t in_channels, std::int64_t hidden_dim, std::int64_t out_channels,
                    const JointEmbedderOptions& options);

  /// @param pairs [ΣJ, in_channels] @return [ΣJ, out_channels]
  torch::Tensor forward(const torch::Tensor& pairs, const nn::Ragged& items);

 private:
  torch::Tensor run_blocks(const torch::Tensor& first, const nn::Ragged& items);

  nn::FeedForward in_layer_ = nullptr;
  std::vector<nn::TransformerBlock> attention_blocks_;  ///< one of the two lists is in use
  std::vector<nn::FeedForward> plain_blocks_;
  nn::Linear out_layer_ = nullptr;
};
TORCH_MODULE(JointEmbedder);

}  // namespace anigen::models
