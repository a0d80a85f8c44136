#pragma once
#include <string>
#include <vector>

#include "anigen/models/structured_latent_flow_options.h"
#include "anigen/models/structured_latent_flow_stream.h"
#include "anigen/nn/init.h"
#include "anigen/sparse/sparse_tensor.h"

namespace anigen::models {

/// The two outputs of a structured-latent flow, at the voxels of its two inputs.
struct StructuredVelocity {
  sparse::SparseTensor x, x_skl;
};

/// The structured-latent flow (the paper's second generation stage; reference flows-and-pipeline.md, 2): three sparse
/// transformers, geometry and skin on the voxels of the shape, skeleton on those of the skeleton, that see the same
/// time. The geometry attends to the condition tokens; the skin hears of it through linear adapters that begin at zero;
/// skin and skeleton attend to each other. Nothing flows back into the geometry.
///
/// Precision: fp32 unless set_compute_dtype() chose another type for the torso; norms, time embeddings, the first and
/// the last layer of each stream stay in fp32.
class StructuredLatentFlowImpl : public torch::nn::Module {
 public:
  explicit StructuredLatentFlowImpl(const StructuredLatentFlowOptions& options, nn::Init init = nn::Init::kPublished);

  /// @param x [N, in_channels + in_channels_vert_skin] on the voxels of the shape, geometry first
  /// @param x_skl [M, in_channels_skl] on those of the skeleton, as many items as x
  /// @param t [B] times multiplied by 1000
  /// @param cond [B or 1, K, cond_channels] condition tokens, for instance 1374 of DINOv2
  /// @param joints_num [B] or [1], how many joints each item shall have; 0 and below: the model may choose; undefined:
  /// it may for all
  /// @return velocities of the dtype of x and x_skl, with the channels out_channels + out_channels_vert_skin, and
  /// out_channels_skl
  /// @throws InputError on wrong shapes, and for a joints_num that a model without use_joint_num_cond is given
  StructuredVelocity forward(const sparse::SparseTensor& x, const sparse::SparseTensor& x_skl, const torch::Tensor& t,
                             const torch::Tensor& cond, const torch::Tensor& joints_num = {});

  /// Names of the modules and parameters that are fp16 in the published system, for published_dtypes(); none without
  /// use_fp16.
  std::vector<std::string> half_precision_modules() const;
  /// Converts the linears and convolutions of the torso in place (reference, 2.7); forward() casts its inputs where
  /// they enter it. Call it before an optimiser takes over the parameters.
  /// @throws NotSupportedError for fp16 on a CPU, where bf16 is the choice
  void set_compute_dtype(torch::Dtype dtype);
  torch::Dtype compute_dtype() const { return nn::dtype_of(torso_weight_); }

  const StructuredLatentFlowOptions& options() const { return options_; }

 private:
  std::vector<StructuredLatentFlowStream*> streams() { return {&geometry_, &skin_, &skeleton_}; }
  void register_streams();
  void check_inputs(const sparse::SparseTensor& x, const sparse::SparseTensor& x_skl, const torch::Tensor& t,
                    const torch::Tensor& cond, const torch::Tensor& joints_num) const;

  StructuredLatentFlowOptions options_;
  StructuredLatentFlowStream geometry_, skin_, skeleton_;
  std::vector<nn::Linear> adapters_;  // geometry → skin, one per block
  // What set_compute_dtype() converts, and any linear weight of it, whose dtype is the compute dtype.
  std::vector<std::string> torso_modules_, torso_parameters_;
  torch::Tensor torso_weight_;
};
TORCH_MODULE(StructuredLatentFlow);

}  // namespace anigen::models
