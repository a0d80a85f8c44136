#include "anigen/models/structured_latent_variant.h"

#include "anigen/core/error.h"
#include "anigen/models/structured_latent_skeleton_loss.h"

namespace anigen::models {
namespace {

using torch::Tensor;

constexpr double kReferencePercentile = 0.99;
constexpr double kLeastLength = 1e-12;

fields::FieldConfidence derived_confidence(const StructuredLatentDecoderOptions& decoder) {
  if (decoder.jp_hyper_continuous) return fields::FieldConfidence::kExplicit;
  return decoder.has_joint_confidence() ? fields::FieldConfidence::kLearned : fields::FieldConfidence::kNone;
}

const char* word_of(fields::FieldConfidence confidence) {
  switch (confidence) {
    case fields::FieldConfidence::kExplicit:
      return "explicit";
    case fields::FieldConfidence::kNone:
      return "none";
    case fields::FieldConfidence::kLearned:
      return "learned";
    default:
      return "bayesian";
  }
}

Tensor relative_precision(const Tensor& log_scale) {
  if (!log_scale.defined() || log_scale.numel() == 0) return log_scale;
  const Tensor precision = torch::exp(-clamped_log_scale(log_scale.to(torch::kFloat32)));
  return (precision / torch::quantile(precision.reshape({-1}), kReferencePercentile)).clamp_max(1.0);
}

}  // namespace

StructuredLatentVariant StructuredLatentVariant::read(ConfigReader& args, const StructuredLatentDecoderOptions& decoder,
                                                      const std::string& compatibility) {
  StructuredLatentVariant variant;
  const fields::FieldConfidence derived = derived_confidence(decoder);
  const std::string word = args.choice("confidence", word_of(derived), {"explicit", "none", "learned", "bayesian"});
  variant.confidence = derived;
  if (word == "bayesian") {
    if (derived != fields::FieldConfidence::kLearned) {
      throw args.error(
          "confidence",
          "\"bayesian\" needs models with jp_hyper_continuous false and use_conf_jp true, whose confidence "
          "channels are free");
    }
    variant.confidence = fields::FieldConfidence::kBayesian;
  } else if (word != word_of(derived)) {
    throw args.error("confidence", "\"" + word +
                                       "\" contradicts the models, whose jp_hyper_continuous and use_conf_jp "
                                       "mean \"" +
                                       word_of(derived) + "\"");
  }
  const std::string norm = args.choice("normalization", compatibility == "paper" ? "l1" : "l2", {"l2", "l1", "none"});
  variant.latent_norm = norm == "l1" ? LatentNorm::kL1 : norm == "none" ? LatentNorm::kNone : LatentNorm::kL2;
  variant.joint_skin = args.choice("skin_ae", "pretrained", {"pretrained", "joint"}) == "joint";
  variant.geometry_only = args.boolean("geometry_only", false);
  return variant;
}

StructuredLatentVariant StructuredLatentVariant::of_run(const Json& run, const StructuredLatentDecoderOptions& decoder,
                                                        const std::string& file) {
  ConfigReader top(run, file);
  ConfigReader args = top.object("trainer").object("args");
  return read(args, decoder, args.text("compatibility", "published"));
}

void StructuredLatentVariant::apply(StructuredLatentEncoderOptions& encoder, const std::string& file) const {
  if (latent_norm == LatentNorm::kNone) encoder.normalize_z = false;
  if (latent_norm == LatentNorm::kL1 && !encoder.normalizes()) {
    throw InputError(file, "/trainer/args/normalization",
                     "\"l1\" needs an encoder with latent_denoising and normalize_z");
  }
}

Tensor renormalized(const Tensor& z, const StructuredLatentEncoderOptions& encoder, LatentNorm norm) {
  if (norm != LatentNorm::kL1) return z;
  return encoder.normalize_scale * z / z.abs().sum(-1, /*keepdim=*/true).clamp_min(kLeastLength);
}

fields::SkeletonField for_grouping(const fields::SkeletonField& field, fields::FieldConfidence confidence) {
  if (confidence != fields::FieldConfidence::kBayesian) return field;
  fields::SkeletonField mapped = field;
  mapped.conf_j = relative_precision(field.conf_j);
  mapped.conf_p = relative_precision(field.conf_p);
  return mapped;
}

}  // namespace anigen::models
