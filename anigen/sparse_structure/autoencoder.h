#pragma once
#include <string>
#include <vector>

#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/nn/trainable.h"
#include "anigen/sparse_structure/flow.h"
#include "anigen/sparse_structure/layers.h"
#include "anigen/sparse_structure/options.h"

namespace anigen::sparse_structure {

/// Base of encoder and decoder of the sparse structure: their layers and how a published state dict lists them, layer
/// by layer for both streams (`_skl` behind the names of the skeleton's). `blocks` and `middle_block` are the torso
/// (docs/reference/autoencoders.md, 3.1).
class SparseStructureCoder : public nn::FreezableModel {
 protected:
  /// @tparam Tokens bottleneck of encode_global, in place of the output of an encoder or the input of a decoder
  template <typename Tokens>
  struct Stream {
    std::string suffix;  ///< of its keys
    bool skeleton = false;
    nn::Conv3d input = nullptr;
    VolumeTorso blocks = nullptr, middle = nullptr;
    VolumeHead out = nullptr;
    Tokens tokens{};
  };

  explicit SparseStructureCoder(const SparseStructureCoderOptions& options);
  /// Residual blocks of all levels, with what changes the resolution between them. @param up of a decoder
  VolumeTorso registered_blocks(const std::string& suffix, const SparseStructureCoderOptions& options, bool up);
  VolumeTorso registered_middle(const std::string& suffix, const SparseStructureCoderOptions& options,
                                std::int64_t channels);
  /// Initial values and freezing, when all is registered.
  template <typename Tokens>
  void finish(const SparseStructureCoderOptions& options, nn::Init init, Stream<Tokens>& shape,
              Stream<Tokens>& skeleton);
};

/// Standard normal draws for sampling the posteriors, shaped as SparseStructureEncoder::latent_shape says. The tensor
/// of a stream whose latent is deterministic is not looked at and may be undefined.
struct PosteriorNoise {
  torch::Tensor z, z_skl;
};

/// Occupancy of surface and skeleton → dense latents at 1/downsampling() of the resolution (paper 3.2.2;
/// docs/reference/autoencoders.md, 3). The two streams do not interact. Fully convolutional: the published edge of 64
/// is not built in, except with encode_global.
///
/// Precision: as SkinAutoEncoder; the published fp16 modules are `blocks` and `middle_block` of both
/// streams. Token bottlenecks (encode_global) stay fp32 here; the published ones attend in fp16.
class SparseStructureEncoderImpl : public SparseStructureCoder {
 public:
  /// Parameters named by modules_to_freeze ask for no gradient if the options say so.
  explicit SparseStructureEncoderImpl(const SparseStructureEncoderOptions& options,
                                      nn::Init init = nn::Init::kPublished);

  /// Latents [B, C, r, r, r], or tokens [B, T, C] with encode_global.
  struct Output {
    torch::Tensor z, mean, logvar;              ///< shape
    torch::Tensor z_skl, mean_skl, logvar_skl;  ///< skeleton
  };
  /// A stream with latent_denoising: z, its detached copy as mean, zeros as logvar. Otherwise a Gaussian posterior and
  /// z = mean + exp(logvar/2) · noise.
  /// @param x [B, in, R, R, R] occupancy as numbers of any type @param x_skl the same for the skeleton
  /// @param noise null: z = mean
  /// @throws InputError when a shape does not fit, or noise of a sampled stream is missing
  Output forward(const torch::Tensor& x, const torch::Tensor& x_skl, const PosteriorNoise* noise = nullptr);

  nn::Latent encode_shape(const torch::Tensor& x, const torch::Tensor& noise = {});  ///< the shape stream alone
  nn::Latent encode_skeleton(const torch::Tensor& x_skl, const torch::Tensor& noise = {});

  /// Shape of z for a batch of grids of edge R; skeleton: of z_skl.
  std::vector<std::int64_t> latent_shape(std::int64_t batch, std::int64_t resolution, bool skeleton) const;

  const SparseStructureEncoderOptions& options() const { return options_; }

 private:
  torch::Tensor run(Stream<GlobalTokenEncoder>& stream, const torch::Tensor& x, std::int64_t channels);
  nn::Latent latent_of(const torch::Tensor& raw, bool deterministic, bool normalize, const torch::Tensor& noise) const;

  SparseStructureEncoderOptions options_;
  Stream<GlobalTokenEncoder> shape_, skeleton_{"_skl", true};
};
TORCH_MODULE(SparseStructureEncoder);

/// Latents of the sparse structure → occupancy of surface and skeleton at downsampling() times their resolution
/// (paper 3.2.2; docs/reference/autoencoders.md, 3). A voxel is occupied where its logit is above 0. Freezing and
/// precision as SparseStructureEncoder.
class SparseStructureDecoderImpl : public SparseStructureCoder {
 public:
  explicit SparseStructureDecoderImpl(const SparseStructureDecoderOptions& options,
                                      nn::Init init = nn::Init::kPublished);

  struct Logits {
    torch::Tensor shape;     ///< [B, out, R, R, R]
    torch::Tensor skeleton;  ///< [B, out_skl, R, R, R]
  };
  /// @param z [B, C, r, r, r], or [B, T, C] with encode_global @param z_skl the same for the skeleton
  /// @throws InputError when a shape does not fit
  Logits forward(const torch::Tensor& z, const torch::Tensor& z_skl);
  torch::Tensor decode_shape(const torch::Tensor& z);  ///< the shape stream alone
  torch::Tensor decode_skeleton(const torch::Tensor& z_skl);

  const SparseStructureDecoderOptions& options() const { return options_; }

 private:
  torch::Tensor run(Stream<GlobalTokenDecoder>& stream, const torch::Tensor& z);

  SparseStructureDecoderOptions options_;
  Stream<GlobalTokenDecoder> shape_, skeleton_{"_skl", true};
};
TORCH_MODULE(SparseStructureDecoder);

/// Class names of the two models of stage 2 in configs.
inline constexpr const char* kSparseStructureEncoderClass = "AniGenSparseStructureEncoder";
inline constexpr const char* kSparseStructureDecoderClass = "AniGenSparseStructureDecoder";

/// The flow model of stage 4 in configs.
inline constexpr const char* kSparseStructureFlowClass = "AniGenSparseStructureFlowModel";

}  // namespace anigen::sparse_structure
