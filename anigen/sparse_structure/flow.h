#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/flow/sampler.h"
#include "anigen/nn/blocks.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/init.h"
#include "anigen/nn/trainable.h"

namespace anigen::sparse_structure {

/// Arguments of the published class AniGenSparseStructureFlowModel; defaults are those of the class
/// (docs/reference/flows.md, 1.1). No suffix: the shape stream, called "ss"; `_skl`: the skeleton stream.
struct SparseStructureFlowOptions : JsonOptions<SparseStructureFlowOptions> {
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

  /// Ours: the shape stream alone, without skeleton stream and exchange (TRELLIS' first flow, TRELLIS* of Table 2).
  bool geometry_only = false;

  void fields(ConfigFields& f);
  /// @throws NotSupportedError for pe_mode "rope"
  void validate(const std::string& file = "", const std::string& pointer = "") const;

  std::int64_t heads() const { return num_heads > 0 ? num_heads : model_channels / num_head_channels; }
  std::int64_t tokens() const;      ///< of the shape stream
  std::int64_t tokens_skl() const;  ///< of the skeleton stream
  bool exchanges_by_attention() const { return z_is_global || z_skl_is_global; }
  bool freezes_shape_stream() const { return use_pretrain_branch && (freeze_pretrain_branch || use_lora_ss); }
  /// True when the streams exchange by cross attention after this block: every cross_adapter_every-th, or the last one
  /// when there are fewer blocks than that.
  bool has_cross_adapter(std::int64_t block) const;
  /// Ranks of the low-rank additions to a block's self attention (the last third of the blocks, else 0) and to its
  /// cross attention (8, 16, 24, … by thirds); docs/reference/flows.md, 1.5.
  std::int64_t lora_rank_self(std::int64_t block) const;
  std::int64_t lora_rank_cross(std::int64_t block) const;
};

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
  /// Path from the other stream into this one: linear adapters, one per block, or cross blocks after some; empty: it
  /// does not.
  std::vector<nn::Linear> adapters;
  std::vector<nn::ModulatedCrossBlock> cross_blocks;
  std::vector<nn::Linear> cross_outputs;

  std::vector<std::int64_t> latent_size(std::int64_t batch) const;
  /// @throws InputError unless x is a batch of latents
  void check_latent(const torch::Tensor& x) const;
  torch::Tensor embed_tokens(const torch::Tensor& x);   ///< latent → [B, N, C]
  torch::Tensor modulation_of(const torch::Tensor& t);  ///< [B] → [B, C], or [B, 6C] with share_mod
  /// @param i number of the block, which shifts its windows (nn::AttentionWindows); cross blocks: of the next one
  torch::Tensor run_block(nn::ModulatedCrossBlock block, const torch::Tensor& h, const torch::Tensor& modulation,
                          const torch::Tensor& context, std::size_t i) const;
  /// Adds what the other stream has to say after block i; both are outputs of block i.
  /// @param crossing how many cross blocks lie before, below 0 when none follows this block
  torch::Tensor receive(std::size_t i, std::int64_t crossing, const torch::Tensor& own, const torch::Tensor& other,
                        const torch::Tensor& modulation);
  torch::Tensor project(const torch::Tensor& h);  ///< [B, N, C] → a latent of out_channels
};

/// The two outputs of a sparse-structure flow, of the shapes of its two inputs.
struct Velocity {
  torch::Tensor shape, skeleton;
};

/// The sparse-structure flow (the paper's first generation stage; docs/reference/flows.md, 1): two transformers over
/// the same latent grid, one for the shape and one for the skeleton, that see the same time and the same condition
/// tokens and exchange after every block through linear adapters that begin at zero.
class SparseStructureFlowImpl : public nn::FlowModel {
 public:
  explicit SparseStructureFlowImpl(const SparseStructureFlowOptions& options, nn::Init init = nn::Init::kPublished);

  /// @param x [B, in_channels, R, R, R], or tokens [B, global_token_num, in_channels] with z_is_global
  /// @param x_skl likewise with the skeleton's widths
  /// @param t [B] times multiplied by 1000
  /// @param cond [B or 1, M, cond_channels] condition tokens, for instance 1374 of DINOv2
  /// @return velocities of the dtype of x and x_skl, with geometry_only zeros for x_skl @throws InputError on wrong
  /// shapes
  Velocity forward(const torch::Tensor& x, const torch::Tensor& x_skl, const torch::Tensor& t,
                   const torch::Tensor& cond);

  /// Sizes of the two latents for a batch, for drawing noise.
  std::vector<std::int64_t> shape_latent_size(std::int64_t batch) const { return shape_.latent_size(batch); }
  std::vector<std::int64_t> skeleton_latent_size(std::int64_t batch) const { return skeleton_.latent_size(batch); }

  const SparseStructureFlowOptions& options() const { return options_; }

 private:
  void describe_streams();
  std::vector<FlowStream*> streams();
  void register_streams();
  void register_exchange(const std::string& direction, const FlowStream& from, FlowStream& to);
  void check_inputs(const torch::Tensor& x, const torch::Tensor& x_skl, const torch::Tensor& t,
                    const torch::Tensor& cond) const;

  SparseStructureFlowOptions options_;
  FlowStream shape_, skeleton_;
};
TORCH_MODULE(SparseStructureFlow);

/// The published initial values of a sparse-structure flow (docs/reference/flows.md, 1.6 and 1.5). Modulation, adapters
/// and last layers are zero: a fresh model answers zero, and both streams ignore each other.
/// @param model the module that owns the streams
void initialize_flow(torch::nn::Module& model, const std::vector<FlowStream*>& streams);

/// Arguments of the trainers of stage 4 beside those all trainers share: those of both flows. Samples are guided with
/// strength 7.5 by default.
struct SparseStructureFlowStageOptions : flow::FlowStageOptions, JsonOptions<SparseStructureFlowStageOptions> {
  // Ours: a loss on the voxels that predicted latents decode to, in place of distances between latents alone.
  double lambda_dice = 0.0;  ///< weight of 1 − Dice of shape and of skeleton; 0: none. Needs ss_dec_path
  double dice_time = 0.9;    ///< items of this time and later take part: earlier predictions are nearly the truth
  std::int64_t dice_from_step = 0;
  /// Ours: share of items whose shape stream sees the clean latent, at any time, and is not judged: a model that finds
  /// the skeleton of a given shape (generate/field_rigger.h). 0: both streams are noisy, as published.
  double p_given_shape = 0.0;

  void fields(ConfigFields& f);  ///< `image_encoder` is read by vision::make_condition_encoder()
};

/// Velocities of the sparse-structure flow for flow::sample_flow: streams shape, then skeleton.
/// @param condition [B, M, C] tokens on the model's device @param guided also the velocity under a condition of zeros
/// @param given_shape the first stream begins as the clean latent of a shape and stays so (p_given_shape)
flow::Velocities structure_velocities(SparseStructureFlow model, const torch::Tensor& condition, bool guided,
                                      bool given_shape = false);

}  // namespace anigen::sparse_structure
