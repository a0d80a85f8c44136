#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/init.h"
#include "anigen/nn/trainable.h"
#include "anigen/sparse/blocks.h"
#include "anigen/sparse/support.h"

namespace anigen::structured_latent {

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

  void fields(ConfigFields& f, const std::string& suffix);
  std::int64_t heads() const { return num_heads > 0 ? num_heads : model_channels / num_head_channels; }
  /// Number of times that the residual blocks halve the resolution.
  std::int64_t levels() const { return io_block_channels ? static_cast<std::int64_t>(io_block_channels->size()) : 0; }
};

/// Arguments of the published classes AniGenElasticSLatFlowModel and AniGenSLatFlowModel, which compute the same;
/// defaults are those of the class (docs/reference/flows.md, 2.1). In JSON the sizes of a stream carry its suffix: none
/// for the geometry, `_vert_skin` for the skin, `_skl` for the skeleton.
struct StructuredLatentFlowOptions : JsonOptions<StructuredLatentFlowOptions> {
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

  /// Ours: the geometry stream alone, without skin and skeleton (TRELLIS' second flow, TRELLIS* of Table 2).
  bool geometry_only = false;

  void fields(ConfigFields& f);
  /// @throws NotSupportedError for pe_mode "rope"
  void validate(const std::string& file = "", const std::string& pointer = "") const;

  bool freezes_geometry() const { return use_pretrain_branch && freeze_pretrain_branch; }
};

/// State that one stream of StructuredLatentFlow carries through a forward pass.
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
  nn::JointCountEmbedder joint_embedder = nullptr;
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
};

/// The two outputs of a structured-latent flow, at the voxels of its two inputs.
struct StructuredVelocity {
  sparse::SparseTensor x, x_skl;
};

/// The structured-latent flow (the paper's second generation stage; docs/reference/flows.md, 2): three sparse
/// transformers, geometry and skin on the voxels of the shape, skeleton on those of the skeleton, that see the same
/// time. The geometry attends to the condition tokens; the skin hears of it through linear adapters that begin at zero;
/// skin and skeleton attend to each other. Nothing flows back into the geometry.
class StructuredLatentFlowImpl : public nn::FlowModel {
 public:
  explicit StructuredLatentFlowImpl(const StructuredLatentFlowOptions& options, nn::Init init = nn::Init::kPublished);

  /// @param x [N, in_channels + in_channels_vert_skin] on the voxels of the shape, geometry first
  /// @param x_skl [M, in_channels_skl] on those of the skeleton, as many items as x
  /// @param t [B] times multiplied by 1000
  /// @param cond [B or 1, K, cond_channels] condition tokens, for instance 1374 of DINOv2
  /// @param joints_num [B] or [1], how many joints each item shall have; 0 and below: the model may choose; undefined:
  /// it may for all
  /// @return velocities of the dtype of x and x_skl, with the channels out_channels + out_channels_vert_skin, and
  /// out_channels_skl; with geometry_only those of skin and skeleton are 0
  /// @throws InputError on wrong shapes, and for a joints_num that a model without use_joint_num_cond is given
  StructuredVelocity forward(const sparse::SparseTensor& x, const sparse::SparseTensor& x_skl, const torch::Tensor& t,
                             const torch::Tensor& cond, const torch::Tensor& joints_num = {});

  const StructuredLatentFlowOptions& options() const { return options_; }

 private:
  std::vector<StructuredLatentFlowStream*> streams();
  void register_streams();
  /// Velocity of the geometry stream alone, [N, in_channels]
  torch::Tensor geometry_velocity(const sparse::SparseTensor& x, const torch::Tensor& t, const torch::Tensor& context);
  void check_inputs(const sparse::SparseTensor& x, const sparse::SparseTensor& x_skl, const torch::Tensor& t,
                    const torch::Tensor& cond, const torch::Tensor& joints_num) const;

  StructuredLatentFlowOptions options_;
  StructuredLatentFlowStream geometry_, skin_, skeleton_;
  std::vector<nn::Linear> adapters_;  // geometry → skin, one per block
};
TORCH_MODULE(StructuredLatentFlow);

/// The published initial values of a structured-latent flow (docs/reference/flows.md, 1.6). Modulations, last
/// convolutions, adapters and last layers are zero: a fresh model answers zero, and the skin hears nothing of the
/// geometry.
/// @param model the module that owns streams and adapters
void initialize_flow(torch::nn::Module& model, const std::vector<StructuredLatentFlowStream*>& streams,
                     const std::vector<nn::Linear>& adapters);

}  // namespace anigen::structured_latent
