#pragma once
#include <string>

#include "anigen/core/config_reader.h"
#include "anigen/fields/skeleton_field.h"
#include "anigen/models/structured_latent_options.h"

namespace anigen::models {

/// How skin and skeleton latents are normalised. Geometry latents never are.
enum class LatentNorm {
  kL2,   ///< as published
  kL1,   ///< as the paper says: the same directions, on the ℓ1 sphere
  kNone  ///< not at all
};

/// Which variant of the structured-latent auto-encoder a run trains, beyond what its models' arguments say. Ours, read
/// from `trainer.args`, also by whoever uses the trained models.
struct StructuredLatentVariant {
  fields::FieldConfidence confidence = fields::FieldConfidence::kExplicit;
  LatentNorm latent_norm = LatentNorm::kL2;
  bool joint_skin =
      false;  ///< `skin_ae` "joint": no pretrained SkinAE; its decoder is trained along, its encoder silent
  bool geometry_only = false;  ///< shape alone is trained
  bool needs_skin_ae() const { return !joint_skin && !geometry_only; }

  /// `confidence` ("explicit", "none", "learned", "bayesian"; absent: what the models' arguments mean), `normalization`
  /// ("l2", "l1", "none"), `skin_ae` ("pretrained", "joint"), `geometry_only`.
  /// @param compatibility "paper": normalization is "l1" unless given @throws InputError when they contradict
  static StructuredLatentVariant read(ConfigReader& trainer_args, const StructuredLatentDecoderOptions& decoder,
                                      const std::string& compatibility);
  /// The same of a run folder's config. @param run the whole config @param file of it, for messages
  static StructuredLatentVariant of_run(const Json& run, const StructuredLatentDecoderOptions& decoder,
                                        const std::string& file);
  /// What the switches change in the models' arguments: `normalization` "none" turns normalize_z off.
  /// @throws InputError when "l1" is wanted of an encoder that does not normalise
  void apply(StructuredLatentEncoderOptions& encoder, const std::string& file) const;
};

/// Latents of skin or skeleton as the variant has them, from what the encoder gives. @param z [N, C] @return [N, C]
torch::Tensor renormalized(const torch::Tensor& z, const StructuredLatentEncoderOptions& encoder, LatentNorm norm);

/// The field with confidences that grouping can compare with a threshold: for kBayesian e^(−s) divided by its 99th
/// percentile in the asset, at most 1 (reference training-and-data.md, 4); otherwise unchanged.
fields::SkeletonField for_grouping(const fields::SkeletonField& field, fields::FieldConfidence confidence);

}  // namespace anigen::models
