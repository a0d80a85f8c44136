#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/nn/modulated_block.h"
#include "anigen/nn/timestep_embedder.h"

namespace anigen::models {

/// The modules of one of the two transformers of SparseStructureFlow, which owns and registers them. Not a module:
/// the published keys interleave the streams (`t_embedder`, `t_embedder_skl`, `input_layer`, …).
struct FlowStream {
  std::string name;  ///< of the input, for messages
  std::int64_t in_channels = 0, out_channels = 0, channels = 0;
  std::int64_t resolution = 0, patch = 1, tokens = 0;
  bool is_global = false;  ///< tokens that form no grid
  bool recompute = false;  ///< blocks keep no activations, see use_checkpoint

  torch::Tensor pos_emb;  ///< [N, C] buffer
  nn::TimestepEmbedder t_embedder = nullptr;
  nn::Modulation shared_modulation = nullptr;  ///< with share_mod
  nn::Linear input_layer = nullptr, out_layer = nullptr;
  std::vector<nn::ModulatedCrossBlock> blocks;
  /// How the other stream enters this one: linear adapters, one per block, or cross blocks after some; empty: it does
  /// not.
  std::vector<nn::Linear> adapters;
  std::vector<nn::ModulatedCrossBlock> cross_blocks;
  std::vector<nn::Linear> cross_outputs;

  std::vector<std::int64_t> latent_size(std::int64_t batch) const;
  /// @throws InputError unless x is a batch of latents
  void check_latent(const torch::Tensor& x) const;
  torch::Tensor embed_tokens(const torch::Tensor& x);   ///< latent → [B, N, C]
  torch::Tensor modulation_of(const torch::Tensor& t);  ///< [B] → [B, C], or [B, 6C] with share_mod
  torch::Tensor run_block(std::size_t i, const torch::Tensor& h, const torch::Tensor& modulation,
                          const torch::Tensor& context);
  /// Adds what the other stream has to say after block i; both are outputs of block i.
  /// @param crossing how many cross blocks lie before, below 0 when none follows this block
  torch::Tensor receive(std::size_t i, std::int64_t crossing, const torch::Tensor& own, const torch::Tensor& other,
                        const torch::Tensor& modulation);
  torch::Tensor project(const torch::Tensor& h);  ///< [B, N, C] → a latent of out_channels

 private:
  torch::Tensor run(nn::ModulatedCrossBlock block, const torch::Tensor& h, const torch::Tensor& modulation,
                    const torch::Tensor& context) const;
};

}  // namespace anigen::models
