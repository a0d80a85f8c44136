#pragma once
#include "anigen/flow/geodesic_noise.h"
#include "anigen/flow/sampler.h"
#include "anigen/nn/state_dict.h"
#include "anigen/structured_latent/flow.h"

namespace anigen::structured_latent {

/// The flow model of stage 5 in configs: two published names of the same computation.
inline constexpr const char* kStructuredLatentFlowClass = "AniGenElasticSLatFlowModel";
inline constexpr const char* kPlainStructuredLatentFlowClass = "AniGenSLatFlowModel";

/// Arguments of the trainers of stage 5 beside those all trainers share: those of both flows, where samples are guided
/// with strength 3 by default, and these (docs/reference/training.md, 3.6).
struct StructuredLatentFlowStageOptions : flow::FlowStageOptions, JsonOptions<StructuredLatentFlowStageOptions> {
  bool use_joint_num_cond = false;  ///< show the model how many joints an asset has
  double p_uncond_joint_num = 0.1;  ///< share of items for which it is told nothing, whatever its picture
  // Ours: losses on the rig fields that predicted latents decode to, since distances between latents count all of their
  // variance alike, whatever a rig needs of it. They need slat_dec_path.
  double lambda_votes = 0.0;         ///< weight of the distance of decoded votes; 0: none
  double lambda_rig_features = 0.0;  ///< weight of the share of the variance of decoded skin features that is missed
  double rig_time = 0.9;             ///< items of this time and later take part
  flow::GeodesicNoiseOptions smoothing;  ///< `geodesic_smooth_noise…`: of the skin's noise, in training and samples

  void fields(ConfigFields& f);  ///< `image_encoder` is read by vision::make_condition_encoder()
};

/// Voxels and condition under which structured latents are sampled.
struct StructuredLatentTarget {
  sparse::SupportPtr shape, skeleton;  ///< voxels of both streams, B items each
  torch::Tensor tokens;                ///< [B or 1, K, C] of condition pictures, on the model's device
  torch::Tensor joints_num;            ///< [B] or [1]; undefined: not asked of the model
};

/// Velocities of the structured-latent flow for flow::sample_flow: features [N, C] on the shape's voxels, then
/// [M, C'] on the skeleton's. The negative pass of guidance has tokens of zeros and 0 joints (docs/reference/flows.md,
/// 4.3).
/// @param guided also the velocity of that pass
flow::Velocities structured_latent_velocities(StructuredLatentFlow model, const StructuredLatentTarget& target,
                                              bool guided);

/// Standard normal noise of both streams, on the CPU, skin channels smoothed along the surface where the options say
/// so (docs/reference/flows.md, 4.4).
flow::Streams structured_latent_noise(const StructuredLatentFlowOptions& model, const sparse::Support& shape,
                                      const sparse::Support& skeleton, const flow::GeodesicNoiseOptions& smoothing,
                                      const at::Generator& generator);

/// Noise of the shape's voxels alone: what structured_latent_noise() draws first. [N, C]
torch::Tensor shape_latent_noise(const StructuredLatentFlowOptions& model, const sparse::Support& shape,
                                 const flow::GeodesicNoiseOptions& smoothing, const at::Generator& generator);

}  // namespace anigen::structured_latent
