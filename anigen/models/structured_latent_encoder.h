#pragma once
#include <string>
#include <vector>

#include "anigen/models/skin_encoder.h"
#include "anigen/models/stream_coder.h"
#include "anigen/models/structured_latent_encoder_inputs.h"
#include "anigen/models/structured_latent_options.h"
#include "anigen/models/structured_latent_torso.h"
#include "anigen/nn/init.h"

namespace anigen::models {

/// Encoder of the structured latents: shape, skin and skeleton streams on sparse voxels (paper 3.3; reference
/// autoencoders.md, 3.1–3.4). Keys as its Appendix A.4. Gradients reach every parameter, the SkinAE's encoder included,
/// unless it is frozen.
///
/// Precision: fp32 as it is built; half_precision_modules() and convert_to_fp16() as SkinAutoEncoder.
class StructuredLatentEncoderImpl : public StreamCoder {
 public:
  /// Parameters named by modules_to_freeze ask for no gradient if the options say so.
  explicit StructuredLatentEncoderImpl(const StructuredLatentEncoderOptions& options,
                                       nn::Init init = nn::Init::kPublished);

  struct Output {
    sparse::SparseTensor z;                            ///< on x: geometry L, then skin Ls channels
    sparse::SparseTensor z_skl;                        ///< on x_skl
    torch::Tensor mean, logvar, mean_skl, logvar_skl;  ///< rows as z and z_skl
    std::vector<torch::Tensor> joint_skin_embeds;      ///< per asset [J, F], of the SkinAE encoder
    std::vector<torch::Tensor> vert_skin_embeds;       ///< per asset [V, F]
    torch::Tensor x_skin, x_skl;                       ///< inputs of the two torsos, for inspection
    std::vector<torch::Tensor> joints_pos;             ///< per asset, what x_skl was made of, for inspection
    torch::Tensor z_geometry, z_skin;  ///< the two parts of z; with a frozen geometry the first carries no gradient
  };
  /// @param x surface voxels with image features @param x_skl skeleton voxels, no channels needed
  /// @param noise standard normal numbers for the sampled posteriors, in the order geometry [N, L], then, where those
  /// are posteriors, skin [N, Ls] and skeleton [M, Lk]; empty: the means
  /// @throws InputError naming what does not fit: batch sizes, channels, voxels outside the grid, values not finite,
  /// meshes and skeletons
  Output forward(const sparse::SparseTensor& x, const sparse::SparseTensor& x_skl, const RiggedMeshes& rigs,
                 const std::vector<torch::Tensor>& noise = {});

  /// Where the voxels take their skin features from: most of what forward() does outside the network. Thread-safe.
  std::vector<VertexMix> skin_lookups(const sparse::Support& voxels, const RiggedMeshes& rigs) const;
  /// forward() with lookups worked out before; the rigs' vertices, faces and surfaces are not read.
  Output forward(const sparse::SparseTensor& x, const sparse::SparseTensor& x_skl, const RiggedMeshes& rigs,
                 const std::vector<VertexMix>& lookups, const std::vector<torch::Tensor>& noise);

  struct SkinFeatures {
    std::vector<torch::Tensor> joints, vertices;  ///< per asset [J, F] and [V, F]
  };
  /// The SkinAE encoder alone: what the decoded features are trained towards.
  SkinFeatures encode_skin(const RiggedMeshes& rigs);

  /// Blocks keep only their inputs for the backward pass and run again in it (see recompute.h). Default:
  /// use_checkpoint.
  void recompute_blocks(bool on) { torso_.recompute_blocks(on); }

  const StructuredLatentEncoderOptions& options() const { return options_; }
  SkinEncoder& skin_encoder() { return skin_encoder_; }

 private:
  struct Latent {
    torch::Tensor z, mean, logvar;
  };
  /// @param noise undefined: the mean
  Latent latent_of(nn::Linear& head, const torch::Tensor& h, bool deterministic, const torch::Tensor& noise);

  StructuredLatentEncoderOptions options_;
  StructuredLatentTorso torso_;
  SkinEncoder skin_encoder_ = nullptr;
  StructuredLatentInputs inputs_;
  PerStream<nn::Linear> out_{nullptr, nullptr, nullptr};
};
TORCH_MODULE(StructuredLatentEncoder);

}  // namespace anigen::models
