#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "anigen/models/joint_count_embedder.h"
#include "anigen/models/structured_latent_flow_options.h"
#include "anigen/nn/timestep_embedder.h"
#include "anigen/sparse/modulated_block.h"
#include "anigen/sparse/residual_block.h"

namespace anigen::models {

/// What one stream of StructuredLatentFlow carries through a forward pass.
struct StructuredLatentFlowState {
  torch::Tensor embedding;   ///< [B, C] of the time and of the joint count: what residual blocks see
  torch::Tensor modulation;  ///< what transformer blocks see: the same, or [B, 6C] with share_mod
  sparse::SparseTensor h;
  std::vector<torch::Tensor> skips;       ///< what the input blocks gave, the last one last
  std::vector<sparse::SupportPtr> finer;  ///< supports that input blocks came down from, finest first
};

/// The modules of one of the three transformers of StructuredLatentFlow, which owns and registers them. Not a module:
/// the published keys interleave the streams (`t_embedder`, `t_embedder_vert_skin`, `input_layer`, …).
struct StructuredLatentFlowStream {
  std::string suffix;  ///< of its keys
  StructuredLatentFlowStreamOptions sizes;
  bool use_skips = true;
  bool recompute = false;  ///< blocks keep no activations, see use_checkpoint

  nn::TimestepEmbedder t_embedder = nullptr;
  nn::Modulation shared_modulation = nullptr;  ///< with share_mod
  JointCountEmbedder joint_embedder = nullptr;
  torch::Tensor joint_unconditional;  ///< [C], with joint_embedder
  nn::Linear input_layer = nullptr, out_layer = nullptr;
  /// Residual blocks: of each resolution, those that keep it, then one that halves it; and the same way back. Empty
  /// without io_block_channels.
  std::vector<sparse::ResidualBlock> input_blocks, out_blocks;
  std::vector<sparse::SparseModulatedCrossBlock> blocks;

  void register_time(torch::nn::Module& model, const StructuredLatentFlowOptions& options);
  void register_modulation(torch::nn::Module& model);
  void register_joint_count(torch::nn::Module& model, const StructuredLatentFlowOptions& options);
  /// Everything between input and output. @param context_channels of the cross attention
  void register_layers(torch::nn::Module& model, const StructuredLatentFlowOptions& options,
                       std::int64_t context_channels);

  /// Input layer, input blocks and position embedding.
  /// @param x [N, in_channels] @param t [B] @param joints_num [B], ignored without joint_embedder
  /// @param dtype of the torso
  StructuredLatentFlowState enter(const sparse::SparseTensor& x, const torch::Tensor& t,
                                  const torch::Tensor& joints_num, torch::Dtype dtype);
  /// h after transformer block i. @param context [M, K] at `places`, or without places [B, M, K]
  sparse::SparseTensor run_block(std::size_t i, const StructuredLatentFlowState& state, const torch::Tensor& context,
                                 const sparse::SupportPtr& places = nullptr) const;
  /// Output blocks and output layer. @return [N, out_channels] in the type of the output layer
  torch::Tensor leave(StructuredLatentFlowState state);

 private:
  void make_residual_blocks();
  void descend(StructuredLatentFlowState& state) const;
  void ascend(StructuredLatentFlowState& state) const;
  torch::Tensor run(const std::vector<torch::Tensor>& inputs,
                    const std::function<torch::Tensor(const std::vector<torch::Tensor>&)>& part) const;
};

}  // namespace anigen::models
