#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/models/sparse_structure_flow_options.h"
#include "anigen/models/sparse_structure_flow_stream.h"
#include "anigen/nn/init.h"

namespace anigen::models {

/// The two outputs of a sparse-structure flow, of the shapes of its two inputs.
struct Velocity {
  torch::Tensor shape, skeleton;
};

/// The sparse-structure flow (the paper's first generation stage; reference flows-and-pipeline.md, 1): two transformers
/// over the same latent grid, one for the shape and one for the skeleton, that see the same time and the same condition
/// tokens and exchange after every block through linear adapters that begin at zero.
///
/// Precision: fp32 unless set_compute_dtype() chose another type for the torso (the blocks and the adapters); norms,
/// embeddings, the first and the last layer stay in fp32.
class SparseStructureFlowImpl : public torch::nn::Module {
 public:
  explicit SparseStructureFlowImpl(const SparseStructureFlowOptions& options, nn::Init init = nn::Init::kPublished);

  /// @param x [B, in_channels, R, R, R], or tokens [B, global_token_num, in_channels] with z_is_global
  /// @param x_skl likewise with the skeleton's widths
  /// @param t [B] times multiplied by 1000
  /// @param cond [B or 1, M, cond_channels] condition tokens, for instance 1374 of DINOv2
  /// @return velocities of the dtype of x and x_skl @throws InputError on wrong shapes
  Velocity forward(const torch::Tensor& x, const torch::Tensor& x_skl, const torch::Tensor& t,
                   const torch::Tensor& cond);

  /// Sizes of the two latents for a batch, for drawing noise.
  std::vector<std::int64_t> shape_latent_size(std::int64_t batch) const { return shape_.latent_size(batch); }
  std::vector<std::int64_t> skeleton_latent_size(std::int64_t batch) const { return skeleton_.latent_size(batch); }

  /// Names of the modules whose linears are fp16 in the published system, for published_dtypes(); none without
  /// use_fp16.
  std::vector<std::string> half_precision_modules() const;
  /// Converts the linears of the torso in place (reference, 1.10); forward() casts its inputs where they enter it.
  /// Call it before an optimiser takes over the parameters.
  /// @throws NotSupportedError for fp16 on a CPU, where bf16 is the choice
  void set_compute_dtype(torch::Dtype dtype);
  torch::Dtype compute_dtype() const { return nn::dtype_of(torso_weight_); }

  const SparseStructureFlowOptions& options() const { return options_; }

 private:
  void describe_streams();
  void register_streams();
  void register_exchange(const std::string& direction, const FlowStream& from, FlowStream& to);
  void check_inputs(const torch::Tensor& x, const torch::Tensor& x_skl, const torch::Tensor& t,
                    const torch::Tensor& cond) const;

  SparseStructureFlowOptions options_;
  FlowStream shape_, skeleton_;
  std::vector<std::string> torso_modules_ = {"blocks", "blocks_skl"};  // what set_compute_dtype() converts
  torch::Tensor torso_weight_;  // any linear weight of the torso: its dtype is the compute dtype
};
TORCH_MODULE(SparseStructureFlow);

}  // namespace anigen::models
